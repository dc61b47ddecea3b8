//! Shared vertices: those that two or more leaves use, with their users.

use super::leaf::Gathered;

/// All shared vertices, numbered in ascending order of their global number. Memory: 12 to 16 bytes for each.
#[derive(Debug, Default)]
pub(crate) struct SharedVertices {
    /// Global number by shared id.
    vertices: Vec<u32>,
    /// Leaves that use a shared vertex, ascending: `users[starts[id]..starts[id + 1]]`.
    users: Vec<u32>,
    starts: Vec<u32>,
    /// Vertices that any leaf uses, each counted once.
    pub(crate) used_vertices: u64,
}

impl SharedVertices {
    /// Finds them. Leaves are numbered as they come, without those that have no triangle.
    pub(crate) fn find(gathered: &[Gathered]) -> Self {
        let mut uses: Vec<(u32, u32)> = Vec::new();
        let mut owners: Vec<(&Gathered, u32)> = Vec::new();
        let mut leaf = 0;
        let mut used_vertices = 0;
        for g in gathered {
            uses.extend(g.foreign.iter().map(|v| (*v, leaf)));
            used_vertices += u64::from(g.own_count);
            if g.owned.is_some() {
                owners.push((g, leaf));
            }
            leaf += u32::from(g.leaf.triangle_count > 0);
        }
        uses.sort_unstable();
        let mut shared = SharedVertices { starts: vec![0], ..SharedVertices::default() };
        for group in uses.chunk_by(|a, b| a.0 == b.0) {
            let vertex = group[0].0;
            let first_user = shared.users.len();
            shared.users.extend(group.iter().map(|u| u.1));
            match owner_using(&owners, vertex) {
                Some(owner) => shared.users.push(owner),
                None => used_vertices += 1,
            }
            if shared.users.len() - first_user >= 2 {
                shared.users[first_user..].sort_unstable();
                shared.vertices.push(vertex);
                shared.starts.push(shared.users.len() as u32);
            } else {
                shared.users.truncate(first_user);
            }
        }
        shared.used_vertices = used_vertices;
        shared
    }

    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.vertices.len()
    }

    /// The leaves that use a shared vertex, ascending.
    pub(crate) fn users(&self, id: u32) -> &[u32] {
        &self.users[self.starts[id as usize] as usize..self.starts[id as usize + 1] as usize]
    }

    /// Appends (local index, shared id) of those of a leaf's `vertices` that are shared. The list is made of ascending runs,
    /// so each search starts where the last one ended.
    pub(crate) fn mark(&self, vertices: &[u32], out: &mut Vec<(u16, u32)>) {
        let mut from = 0;
        let mut last = 0;
        for (local, &vertex) in vertices.iter().enumerate() {
            if vertex < last {
                from = 0;
            }
            last = vertex;
            from = gallop(&self.vertices, from, vertex);
            if self.vertices.get(from) == Some(&vertex) {
                out.push((local as u16, from as u32));
            }
        }
    }
}

/// The leaf of the cluster that owns `vertex`, if it uses it.
fn owner_using(owners: &[(&Gathered, u32)], vertex: u32) -> Option<u32> {
    let end = |g: &Gathered| g.owned.as_ref().map_or(0, |o| o.end);
    let (owner, leaf) = owners.get(owners.partition_point(|(g, _)| end(g) <= vertex))?;
    let owned = owner.owned.as_ref().is_some_and(|o| o.contains(&vertex));
    (owned && owner.unused.binary_search(&vertex).is_err()).then_some(*leaf)
}

/// The first index at or after `from` whose item is not below `wanted`, by doubling steps.
fn gallop(items: &[u32], from: usize, wanted: u32) -> usize {
    let mut step = 1;
    let mut low = from;
    while low + step <= items.len() && items[low + step - 1] < wanted {
        low += step;
        step *= 2;
    }
    let high = (low + step).min(items.len());
    low + items[low..high].partition_point(|item| *item < wanted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn galloping_finds_what_searching_finds() {
        let items: Vec<u32> = (0..100).map(|i| 3 * i).collect();
        for from in [0, 1, 7, 50, 99, 100] {
            for wanted in 0..310 {
                let expected = from.max(items.partition_point(|i| *i < wanted));
                assert_eq!(gallop(&items, from, wanted), expected, "{wanted} from {from}");
            }
        }
    }
}

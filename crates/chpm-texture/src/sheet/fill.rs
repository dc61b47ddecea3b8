//! Texels that nothing covers: the next that are covered go on over them.

/// Rings of texels that are the mean of their neighbours.
const RINGS: usize = 3;

/// A rectangle of texels, of which some have a colour.
pub(super) struct Patch<'a> {
    pub(super) texels: &'a mut [[u8; 4]],
    pub(super) known: &'a mut [bool],
    /// Texels from a row to the next.
    pub(super) stride: usize,
    /// Column, row, width, height.
    pub(super) rect: [usize; 4],
}

impl Patch<'_> {
    /// Where a row begins.
    fn row(&self, row: usize) -> usize {
        (self.rect[1] + row) * self.stride + self.rect[0]
    }

    /// Gives a colour to every texel, if one has any: rings about what is known, then means of ever larger squares.
    pub(super) fn fill(&mut self) {
        let (mut near, mut ring) = (Vec::new(), Vec::new());
        for _ in 0..RINGS {
            self.grow(&mut near, &mut ring);
        }
        self.spread();
    }

    /// Gives a colour to texels beside known ones.
    fn grow(&mut self, near: &mut Vec<bool>, ring: &mut Vec<(usize, [u8; 4])>) {
        let [_, _, width, height] = self.rect;
        ring.clear();
        for row in 0..height {
            let rows = row.saturating_sub(1)..(row + 2).min(height);
            // Whether a column has a known texel in these rows.
            near.clear();
            near.resize(width, false);
            for begin in rows.clone().map(|row| self.row(row)) {
                near.iter_mut()
                    .zip(&self.known[begin..begin + width])
                    .for_each(|(near, known)| *near |= known);
            }
            let begin = self.row(row);
            for column in 0..width {
                let columns = column.saturating_sub(1)..(column + 2).min(width);
                if self.known[begin + column] || !near[columns.clone()].contains(&true) {
                    continue;
                }
                let (mut sum, mut count) = ([0u32; 4], 0u32);
                for at in rows
                    .clone()
                    .map(|row| self.row(row))
                    .flat_map(|begin| columns.clone().map(move |x| begin + x))
                {
                    if self.known[at] {
                        (0..4).for_each(|i| sum[i] += u32::from(self.texels[at][i]));
                        count += 1;
                    }
                }
                ring.push((begin + column, sum.map(|part| ((part + count / 2) / count) as u8)));
            }
        }
        for (at, color) in ring {
            (self.texels[*at], self.known[*at]) = (*color, true);
        }
    }

    /// Gives all others the mean of the least square of a grid that has a colour.
    pub(super) fn spread(&mut self) {
        let [_, _, width, height] = self.rect;
        let is_known = |patch: &Self, row| patch.known[patch.row(row)..][..width].iter().all(|known| *known);
        if (0..height).all(|row| is_known(self, row)) {
            return;
        }
        let mut levels: Vec<Level> = Vec::new();
        let mut size = [width, height];
        while size[0] * size[1] > 1 {
            let halved = match levels.last() {
                None => Level::halved(size, |row| {
                    let begin = self.row(row);
                    (&self.texels[begin..begin + width], &self.known[begin..begin + width])
                }),
                Some(Level { width, means, known }) => Level::halved(size, |row| {
                    (&means[row * width..][..*width], &known[row * width..][..*width])
                }),
            };
            size = size.map(|side| side.div_ceil(2));
            levels.push(halved);
        }
        for row in 0..height {
            let begin = self.row(row);
            for column in (0..width).filter(|column| !self.known[begin + column]) {
                let mean = levels.iter().zip(1..).find_map(|(level, halvings): (_, u32)| {
                    let at = (row >> halvings) * level.width + (column >> halvings);
                    level.known[at].then(|| level.means[at])
                });
                if let Some(mean) = mean {
                    self.texels[begin + column] = mean;
                }
            }
        }
        if levels.last().is_some_and(|level| level.known.contains(&true)) {
            for begin in (0..height).map(|row| self.row(row)).collect::<Vec<_>>() {
                self.known[begin..begin + width].fill(true);
            }
        }
    }
}

/// Means of the known ones of two by two texels.
struct Level {
    width: usize,
    means: Vec<[u8; 4]>,
    known: Vec<bool>,
}

impl Level {
    fn halved<'a>([width, height]: [usize; 2], row: impl Fn(usize) -> (&'a [[u8; 4]], &'a [bool])) -> Level {
        let halved = [width, height].map(|side| side.div_ceil(2));
        let mut level = Level {
            width: halved[0],
            means: Vec::with_capacity(halved[0] * halved[1]),
            known: Vec::with_capacity(halved[0] * halved[1]),
        };
        for above in (0..height).step_by(2) {
            let rows = [row(above), row((above + 1).min(height - 1))];
            let rows = &rows[..(height - above).min(2)];
            for begin in (0..width).step_by(2) {
                let (mut sum, mut count) = ([0u32; 4], 0u32);
                for (texels, known) in rows {
                    for at in (begin..(begin + 2).min(width)).filter(|at| known[*at]) {
                        (0..4).for_each(|i| sum[i] += u32::from(texels[at][i]));
                        count += 1;
                    }
                }
                let most = count.max(1);
                level.means.push(sum.map(|part| ((part + most / 2) / most) as u8));
                level.known.push(count > 0);
            }
        }
        level
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_known_texel_fills_its_rectangle_and_no_more() {
        let (mut texels, mut known) = (vec![[0; 4]; 20 * 10], vec![false; 200]);
        (texels[3 * 20 + 5], known[3 * 20 + 5]) = ([10, 20, 30, 255], true);
        Patch { texels: &mut texels, known: &mut known, stride: 20, rect: [2, 1, 13, 8] }.fill();
        for (at, (texel, known)) in texels.iter().zip(&known).enumerate() {
            let is_in = (2..15).contains(&(at % 20)) && (1..9).contains(&(at / 20));
            assert_eq!(
                (*texel, *known),
                if is_in { ([10, 20, 30, 255], true) } else { ([0; 4], false) },
                "{at}"
            );
        }
    }

    #[test]
    fn known_texels_stay_and_neighbours_are_near() {
        let (mut texels, mut known) = (vec![[0; 4]; 64 * 64], vec![false; 64 * 64]);
        for at in (0..64 * 64).filter(|at| (at % 64) < 8) {
            (texels[at], known[at]) = ([(at % 64 * 20) as u8, 0, 0, 255], true);
        }
        let before = texels.clone();
        Patch { texels: &mut texels, known: &mut known, stride: 64, rect: [0, 0, 64, 64] }.fill();
        for at in 0..64 * 64 {
            if at % 64 < 8 {
                assert_eq!(texels[at], before[at]);
            } else if at % 64 < 11 {
                assert_eq!(texels[at], [140, 0, 0, 255], "{at}");
            }
        }
        assert!(known.iter().all(|known| *known));
    }
}

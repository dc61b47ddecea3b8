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
    fn at(&self, column: usize, row: usize) -> usize {
        (self.rect[1] + row) * self.stride + self.rect[0] + column
    }

    /// Gives a colour to every texel, if one has any: rings about what is known, then means of ever larger squares.
    pub(super) fn fill(&mut self) {
        for _ in 0..RINGS {
            self.grow();
        }
        self.spread();
    }

    /// Gives a colour to texels beside known ones.
    fn grow(&mut self) {
        let [_, _, width, height] = self.rect;
        let mut ring = Vec::new();
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            if self.known[self.at(column, row)] {
                continue;
            }
            let (mut sum, mut count) = ([0u32; 4], 0u32);
            for y in row.saturating_sub(1)..(row + 2).min(height) {
                for x in column.saturating_sub(1)..(column + 2).min(width) {
                    if self.known[self.at(x, y)] {
                        let texel = self.texels[self.at(x, y)];
                        (0..4).for_each(|i| sum[i] += u32::from(texel[i]));
                        count += 1;
                    }
                }
            }
            if count > 0 {
                ring.push((self.at(column, row), sum.map(|part| ((part + count / 2) / count) as u8)));
            }
        }
        for (at, color) in ring {
            (self.texels[at], self.known[at]) = (color, true);
        }
    }

    /// Gives all others the mean of the least square of a grid that has a colour.
    pub(super) fn spread(&mut self) {
        let [_, _, width, height] = self.rect;
        let mut sides = vec![[width, height]];
        let mut levels: Vec<Vec<[u32; 5]>> = vec![Vec::new()];
        while let Some([w, h]) = sides.last().copied().filter(|[w, h]| w * h > 1) {
            let [halved_w, halved_h] = [w.div_ceil(2), h.div_ceil(2)];
            let mut sums = vec![[0u32; 5]; halved_w * halved_h];
            for (row, column) in (0..h).flat_map(|row| (0..w).map(move |column| (row, column))) {
                let mean = match levels.len() {
                    1 => {
                        let at = self.at(column, row);
                        let [r, g, b, a] = self.texels[at].map(u32::from);
                        if self.known[at] { [r, g, b, a, 1] } else { [0; 5] }
                    }
                    level => levels[level - 1][row * w + column],
                };
                let sum = &mut sums[row / 2 * halved_w + column / 2];
                (0..5).for_each(|i| sum[i] += mean[i]);
            }
            for sum in &mut sums {
                let count = sum[4].max(1);
                *sum = sum.map(|part| (part + count / 2) / count);
                sum[4] = sum[4].min(1);
            }
            levels.push(sums);
            sides.push([halved_w, halved_h]);
        }
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            let at = self.at(column, row);
            if self.known[at] {
                continue;
            }
            let found = (1..levels.len()).find_map(|level| {
                let mean = levels[level][(row >> level) * sides[level][0] + (column >> level)];
                (mean[4] > 0).then_some(mean)
            });
            if let Some([r, g, b, a, _]) = found {
                self.texels[at] = [r, g, b, a].map(|part| part as u8);
            }
        }
        for row in 0..height {
            let at = self.at(0, row);
            self.known[at..at + width].fill(true);
        }
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

//! Range grids: the samples of a scanner in rows and columns, some of them missing. Neighbours become triangles.

use super::{
    error::Fault,
    header::{Element, Header, words},
    read::Body,
    schema::ListPlan,
};
use crate::batch::Batch;
use std::io::Read;

/// Two rows of a grid, and where the reader is.
#[derive(Debug, Default)]
pub(super) struct Grid {
    /// Samples of the row before and of the row that is being read; none where the scanner saw nothing.
    above: Vec<Option<u32>>,
    row: Vec<Option<u32>>,
}

/// Samples of a row, if the header says so and there are whole rows.
pub(super) fn columns(header: &Header, count: u64) -> Option<u64> {
    let columns = header.obj_info.iter().find_map(|line| {
        let mut words = words(line);
        (words.next() == Some("num_cols")).then(|| words.next()?.parse().ok()).flatten()
    });
    columns.filter(|columns| *columns > 0 && count.is_multiple_of(*columns))
}

impl<R: Read> Body<R> {
    /// Reads samples until the batch is full or there are no more of them.
    pub(super) fn grid(
        &mut self,
        element: &Element,
        plan: &ListPlan,
        columns: u64,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        while self.index < element.count && batch.triangles.len() < Batch::FULL {
            let sample = self.sample(element, plan)?;
            let grid = &mut self.grid;
            let column = grid.row.len();
            if let (Some(left), Some(above)) = (column.checked_sub(1), grid.above.get(column)) {
                // Counterclockwise for whoever looks from where rows go up and columns to the right.
                let (a, b, d) = (grid.above[left], *above, grid.row[left]);
                batch.triangles.extend(cell([a, b, sample, d]).into_iter().flatten());
            }
            grid.row.push(sample);
            if grid.row.len() as u64 == columns {
                std::mem::swap(&mut grid.above, &mut grid.row);
                grid.row.clear();
            }
            self.index += 1;
        }
        Ok(())
    }

    /// One sample: a list of one vertex, or an empty one.
    fn sample(&mut self, element: &Element, plan: &ListPlan) -> Result<Option<u32>, Fault> {
        self.source.begin_element()?;
        self.source.skip_values(element.properties[..plan.property].iter().map(|property| &property.ty))?;
        let count = self.source.count(plan.count)?;
        let mut sample = None;
        for at in 0..count {
            let corner = self.corner(plan.item)?;
            if at == 0 {
                sample = corner;
            }
        }
        self.source
            .skip_values(element.properties[plan.property + 1..].iter().map(|property| &property.ty))?;
        Ok(sample)
    }
}

/// The triangles of four neighbours in a ring, or the one of three of them. A sample that is named twice makes none.
fn cell(ring: [Option<u32>; 4]) -> [Option<[u32; 3]>; 2] {
    let [a, b, c, d] = ring;
    if a.is_some() && c.is_some() {
        [triangle([a, b, c]), triangle([a, c, d])]
    } else {
        [triangle([a, b, d]), triangle([b, c, d])]
    }
}

fn triangle(corners: [Option<u32>; 3]) -> Option<[u32; 3]> {
    match corners {
        [Some(a), Some(b), Some(c)] if a != b && b != c && c != a => Some([a, b, c]),
        _ => None,
    }
}

//! The faults of a certification, in words.

use super::Certified;
use chpm_mesh::{Counted, Units};

/// Every row that is not proven, in words, and the number of triangles. Places are told in the source's coordinates.
pub fn faults(certified: &Certified, origin: [f64; 3]) -> (Vec<String>, u64) {
    let mut faults = Vec::new();
    for row in certified.rows() {
        for (side, from, to, what) in
            [(&row.of_mesh, "mesh", "source", "error"), (&row.of_source, "source", "mesh", "distance")]
        {
            let name = row.name();
            if let Some(worst) = side.worst {
                let [x, y, z] = absolute(worst.at, origin);
                let triangles = Counted(side.violations, "triangle");
                faults.push(format!(
                    "I5 error: {name}: {triangles} of the {from} farther from the {to} than the stored {what}; the worst point, \
                     at {x} {y} {z}, by {} units at least where {} are stored",
                    Units(worst.distance),
                    Units(worst.stored)
                ));
            }
            if side.undecided > 0 {
                let triangles = Counted(side.undecided, "triangle");
                faults.push(format!(
                    "I5 error: {name}: {triangles} of the {from} neither proven nor refuted; a larger --effort may decide"
                ));
            }
        }
    }
    (faults, certified.rows().map(|row| row.violations() + row.undecided()).sum())
}

fn absolute(at: [f64; 3], origin: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| at[axis] + origin[axis])
}

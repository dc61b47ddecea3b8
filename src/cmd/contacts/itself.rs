//! Where a model meets itself.

use super::Args;
use crate::json::{self, near};
use crate::memory;
use crate::output::Output;
use crate::proximity::{AskArgs, GROUP, Opened};
use crate::stop::{self, Stop};
use anyhow::{Context, Result, bail};
use chpm_mesh::{Bytes, Counted};
use chpm_proximity::{Crossing, Model, Reads, crossings};
use std::io::Write;

pub(super) fn within_itself(
    args: &Args,
    stop: &Stop,
    mut csv: Option<Output>,
    out: &mut dyn Write,
) -> Result<Option<Output>> {
    let AskArgs { first, limits, threads, tell, .. } = &args.ask;
    let model = Opened::new(first, limits.memory.0, tell.quiet, stop)?;
    let own = GROUP * model.file.clusters().len() as u64;
    let pages = memory::divide(&model.file, limits.memory.0, own)?;

    if model.file.is_trimmed() {
        bail!(
            "'{}' was built without detail below an error, so its leaves are not the source",
            model.path.display()
        );
    }

    let cancel = stop.heed();
    let origin = model.file.header().origin;
    let (mut pairs, mut first) = (0, None);
    let (limits, pool) = (limits.start(&cancel), threads.pool()?);
    let complete = crate::cmd::reading(&model.file, || {
        let reader = Model::new(&model.file, Bytes(pages))
            .with_context(|| format!("cannot use '{}'", model.path.display()))?;
        if let Some(csv) = &mut csv {
            writeln!(csv, "cluster_a,triangle_a,cluster_b,triangle_b,x,y,z")?;
        }
        let found = &mut |crossing: &Crossing| {
            pairs += 1;
            first = first.or(Some(*crossing));
            match &mut csv {
                Some(csv) => write_crossing(crossing, origin, csv),
                None => Ok(()),
            }
        };
        let complete = crossings(&reader, &pool, found, &mut || limits.go_on(Reads::default()))?;
        stop::check(&cancel)?;
        Ok(complete)
    })?;

    if args.ask.tell.json {
        let file = model.json();
        json::print(&near::ContactsSelf { schema: "chpm-contacts-self/1", file, complete, pairs }, out)?;
    } else {
        let name = model.path.display();
        let found = Counted(pairs, "pair of triangles");
        writeln!(out, "{name}: {found} that meet and have no vertex in common")?;
        if let Some(crossing) = first {
            let [x, y, z] = place(&crossing, origin);
            writeln!(out, "  the first near {x} {y} {z}; --csv has all")?;
        }
        if !complete {
            writeln!(out, "stopped at the limit: there may be more")?;
        }
    }
    Ok(csv)
}

/// A corner of the first triangle, in the source's coordinates.
fn place(crossing: &Crossing, origin: [f64; 3]) -> [f64; 3] {
    let corner = crossing.corners[0][0];
    [0, 1, 2].map(|axis| f64::from(corner[axis]) + origin[axis])
}

fn write_crossing(crossing: &Crossing, origin: [f64; 3], out: &mut impl Write) -> Result<()> {
    let ([x, y], [t, u]) = (crossing.clusters.map(|cluster| cluster.0), crossing.triangles);
    let [px, py, pz] = place(crossing, origin);
    Ok(writeln!(out, "{x},{t},{y},{u},{px},{py},{pz}")?)
}

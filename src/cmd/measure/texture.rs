//! `chpm measure --texture`: colours of sheets beside those of the source's images.

use super::Args;
use crate::cmd::{Verdict, stdout};
use crate::json::{self, judged, named};
use crate::number::Units;
use crate::progress::Meter;
use crate::report::{count, table};
use crate::stop::Stop;
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_verify::{LevelTexture, TextureMeasures, measure_texture};
use std::io::Write;
use std::path::Path;

pub(super) fn run(file: &Chpm<MappedFile>, args: &Args, source: &Path, stop: &Stop) -> Result<Verdict> {
    let measures = TextureMeasures { positions: args.positions, samples: args.samples };
    let scratch = args.storage.work_dir.clone().unwrap_or_else(std::env::temp_dir);
    let (memory, meter, cancel) = (args.storage.memory(), Meter::new(args.quiet), stop.heed());
    let levels = measure_texture(file, source, &measures, memory, &scratch, &meter, &cancel)?;
    let mut out = stdout();
    if args.json {
        let measure = judged::MeasureTexture {
            schema: "chpm-measure-texture/1",
            file: named(&args.first),
            source: named(source),
            samples_per_triangle: args.samples,
            levels: levels.iter().map(to_json).collect(),
        };
        json::print(&measure, &mut out)?;
    } else {
        print(&levels, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

fn to_json(of: &LevelTexture) -> judged::TextureOfLevel {
    let LevelTexture { level, collapsed, triangles, difference, slide } = of;
    judged::TextureOfLevel {
        level: *level,
        collapsed: *collapsed,
        triangles: *triangles,
        samples: difference.samples,
        median: difference.median,
        p95: difference.p95,
        p99: difference.p99,
        psnr: difference.psnr.is_finite().then_some(difference.psnr),
        slide: judged::Slide {
            samples: slide.samples,
            outside: slide.outside,
            max: slide.max,
            of_bound: slide.of_bound,
            beyond: slide.beyond,
        },
    }
}

fn print(levels: &[LevelTexture], out: &mut impl Write) -> Result<()> {
    let header = [
        "",
        "triangles",
        "samples",
        "median",
        "p95",
        "p99",
        "PSNR",
        "slide",
        "of bound",
        "beyond",
        "outside",
    ];
    let rows = levels.iter().map(|of| {
        let LevelTexture { level, collapsed, triangles, difference, slide } = of;
        let all = slide.samples + slide.outside;
        vec![
            format!("level {level}, {:.0} %", 100.0 * collapsed),
            count(*triangles),
            count(all),
            format!("{:.1}", difference.median),
            format!("{:.1}", difference.p95),
            format!("{:.1}", difference.p99),
            if difference.samples > 0 { format!("{:.1} dB", difference.psnr) } else { "-".to_owned() },
            Units(slide.max).to_string(),
            format!("{:.2}", slide.of_bound),
            count(slide.beyond),
            format!("{:.2} %", 100.0 * slide.outside as f64 / all.max(1) as f64),
        ]
    });
    writeln!(out, "{}\n", table(&header, rows))?;
    writeln!(
        out,
        "median to p99: difference to the source's colour at the nearest point, of 255; slide: how far a colour is from where the \
         source has it, in units of the model; of bound: the largest part of what stored errors allow; outside: samples that \
         show filled texels, of which neither is known"
    )?;
    Ok(())
}

//! Pictures by rays.

use super::{Args, Gallery, Ready, Verdict, Views, empty_view, judge, legend, outputs, print_views, views};
use crate::cmd::{open, reading};
use crate::json::{self, seen};
use crate::memory;
use crate::output;
use crate::picture::{self, rays};
use crate::progress::Meter;
use crate::report::count;
use crate::stop::{self, Stop};
use anyhow::{Context, Result};
use chpm_mesh::{Bytes, Counted};
use chpm_rays::still::{self, Cast, Paint, Still, StillMemory};
use chpm_rays::{Caster, Memory, Reads};
use chpm_refine::{Outline, Portrait, told_by};
use chpm_viewer::{Image, Look};
use std::io::Write;
use std::time::Instant;

/// Traces and writes.
pub(super) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let colors = rays::paint(args.look.look().colors, None, &[]);
    let pngs = outputs(args)?;
    let mut out = output::messages(&pngs, args.json, false)?;
    colors?;
    let model = Ready::new(&args.file, args, stop)?;
    let begun = Instant::now();
    let file = open(&model.file)?;
    let own = StillMemory::own(&file, args.viewport.0);
    let (pool, free) = memory::workers(&args.rays.threads, &file, args.memory, own, Memory::THREAD)?;
    let memory = StillMemory::divide(Bytes(free), pool.current_num_threads());

    // What is drawn, and from where.
    let paint = rays::paint(args.look.look().colors, args.color_by.as_deref(), file.scalars())?;
    let shown = if let Paint::Scalar(_, scalar) = &paint { Some(scalar) } else { None };
    let legend = legend(args, shown, file.scalars().iter())?;
    let header = file.header();
    let mut stretch = [1.0; 3];
    let mut zero = header.origin;
    let Views { cameras, why, note } = views(args, || {
        let own = file.metadata().map(|metadata| told_by(&metadata)).unwrap_or_default();
        let (up, side) = (args.stance.up.or(own.0), args.stance.side.or(own.1));
        let outline = reading(&file, || Ok(Outline::of_file(&file)?))?;
        let portrait = Portrait::new(outline, header.aabb(), up, side).with_heights(header.origin, up, side);
        stretch = portrait.stretch().into();
        zero = [0, 1, 2].map(|axis| stretch[axis] * header.origin[axis]);
        Ok((portrait, zero))
    })?;
    let (shadows, width, occlusion, ground) = args.rays.light(header.aabb().diagonal(), args.still.studio);
    let look = Look { transparent: args.still.transparent, ..args.look.look_on(ground) };
    let lights: Vec<[f64; 2]> = args.still.light.iter().map(|light| light.0).collect();

    let (mut total, mut short) = (Cast::default(), None);
    let mut gallery = Gallery::new(args, pngs, [note.clone(), legend]);
    let mut caster = Caster::new(&file, memory.rays);
    let meter = Meter::new(args.quiet);
    let pixels = args.viewport.0.map(u64::from).iter().product::<u64>();
    meter.start("rays", pixels * cameras.len() as u64);
    for (place, camera) in cameras.iter().enumerate() {
        let still = Still {
            camera: camera.relative_to(zero),
            viewport: args.viewport.0,
            poe: args.poe,
            samples: args.still.samples,
            smooth: look.shading == chpm_viewer::Shading::Smooth,
            paint: paint.clone(),
            background: look.background,
            transparent: look.transparent,
            studio: args.still.studio,
            lights: if lights.is_empty() { vec![Look::LIGHT] } else { lights.clone() },
            width,
            shadows,
            occlusion,
            ground,
            clip: args.still.clip.map(|clip| (clip.normal(), clip.offset_from(zero))),
            stretch,
        };
        let go_on = memory::go_on(&cancel);
        let take = || still::draw(&mut caster, &still, memory, &go_on, |pixels| meter.add(pixels));
        let picture = reading(&file, || Ok(pool.install(take)?))
            .with_context(|| format!("cannot draw '{}' so", args.file.display()))?;
        stop::check(&cancel)?;
        let Cast { camera, seen, shadow, occlusion } = picture.cast;
        if seen == 0 {
            let of = cameras.len();
            let why = empty_view(&format!("'{}'", args.file.display()));
            short = short.or(Some(if of > 1 { format!("view {} of {of}: {why}", place + 1) } else { why }));
        }
        total = Cast {
            camera: total.camera + camera,
            seen: total.seen + seen,
            shadow: total.shadow + shadow,
            occlusion: total.occlusion + occlusion,
        };
        gallery.add(place, Image { size: args.viewport.0, pixels: picture.pixels })?;
    }
    meter.finish();
    let (reads, time) = (caster.reads(), begun.elapsed());
    let size = gallery.publish(look)?;

    if args.json {
        let still = seen::Still {
            schema: "chpm-still/1",
            image: seen::Size { width: size[0], height: size[1] },
            views: cameras.len(),
            camera: cameras.first().map(picture::camera_as_json),
            stance: why,
            poe: args.poe,
            camera_rays: total.camera,
            seen: total.seen,
            shadow_rays: total.shadow,
            occlusion_rays: total.occlusion,
            triangles: reads.triangles,
            pages: reads.pages,
            page_bytes: reads.bytes,
            pages_different: reads.different,
            milliseconds: 1e3 * time.as_secs_f64(),
        };
        json::print(&still, &mut out)?;
    } else {
        print(args, &total, &reads, &mut out)?;
        writeln!(
            out,
            "{:.0} ms on {}",
            1e3 * time.as_secs_f64(),
            Counted(pool.current_num_threads() as u64, "thread")
        )?;
        print_views(cameras.len(), why, &mut out)?;
    }
    out.flush()?;
    Ok(judge(args, note, short))
}

fn print(args: &Args, cast: &Cast, reads: &Reads, out: &mut impl Write) -> Result<()> {
    let Cast { camera, seen, shadow, occlusion } = *cast;
    writeln!(
        out,
        "{}: {}, {} of which met the model; to lights: {}, for the light from all around: {}",
        args.output.display(),
        Counted(camera, "ray"),
        count(seen),
        count(shadow),
        count(occlusion),
    )?;
    let Reads { pages, bytes, different, triangles } = *reads;
    writeln!(
        out,
        "{} of {} read, {}; {} of them different",
        Counted(pages, "page"),
        Counted(triangles, "triangle"),
        Bytes(bytes),
        count(different)
    )?;
    Ok(())
}

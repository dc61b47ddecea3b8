//! A number for each vertex of the leaves, found by rays from it.

use crate::cmd::{open, reading};
use crate::compare::{Painted, Parts, Summary, leaves, plot};
use crate::json::{named, near};
use crate::memory::{self, MemoryArgs};
use crate::output::{self, Output, Writes};
use crate::progress::Meter;
use crate::stop::{self, Stop};
use crate::threads::{ThreadArgs, Workers};
use anyhow::Result;
use chpm_build::Cancel;
use chpm_export::tiles::SharedNormals;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Page};
use chpm_mesh::{Bytes, ClusterId};
use chpm_rays::{Bound, Caster, Hit, Memory, Ray, Seek, Sides};
use chpm_report::colors::Colors;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of a verb that has a number for each vertex.
#[derive(clap::Args, Debug)]
pub(crate) struct ScalarArgs {
    /// The .chpm file
    pub(crate) file: PathBuf,
    /// Write the leaves with these numbers as colours, evenly spaced for the eye; grey is none. The name says the format: .ply, .glb, .gltf or .chpm, which is built from
    /// it; PLY where it says nothing; - for standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Round positions in a glTF to 16 bits an axis, colours to 8 (KHR_mesh_quantization)
    #[arg(long, requires = "output")]
    quantize: bool,
    /// Write a histogram as SVG; - for standard output
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Replace outputs that exist
    #[arg(short, long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadArgs,
    /// The summary as JSON on stdout
    #[arg(long)]
    pub(crate) json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// A question about each vertex.
pub(crate) trait Asked {
    /// The verb.
    const BY: &'static str;
    /// Its histogram.
    const SVG: Writes;
    /// Its words along the histogram.
    const ALONG: &'static str;
    /// How rays end.
    const SEEK: Seek;
    /// Whether it asks for normals.
    const NORMALS: bool;

    /// Whether normals are taken the other way around.
    fn turn(&self) -> InsideOut {
        InsideOut::No
    }

    /// Rays of a vertex, always as many.
    fn rays(&self, at: [f64; 3], normal: [f64; 3], out: &mut Vec<Ray>);

    /// The number by what its rays met; none where there is no number.
    fn value(&mut self, hits: &[Option<Hit>]) -> f64;
}

/// Which components of a model are turned inside out.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum InsideOut {
    /// Those whose triangles enclose less than nothing
    Auto,
    /// None
    No,
    /// All
    Yes,
}

/// Bytes of a vertex: its number once in each leaf that has it, and as summed up or sorted; and the normal of a shared one.
const VERTEX: u64 = 20;

/// A file, and what is made of its numbers.
pub(crate) struct Scalars<'a> {
    pub(crate) args: &'a ScalarArgs,
    pub(crate) file: Chpm<MappedFile>,
    painted: Option<Painted>,
    svg: Option<Output>,
    pub(crate) out: Box<dyn Write>,
    pool: Workers,
    memory: Memory,
    cancel: Cancel,
}

/// Numbers that were found.
pub(crate) struct Measured {
    pub(crate) parts: Parts,
    /// Reads of pages.
    pub(crate) pages: u64,
    /// Components, and those of them that are turned inside out; nothing where that was not asked.
    pub(crate) turned: Option<[u64; 2]>,
}

impl<'a> Scalars<'a> {
    /// Opens the file, and what is to be written.
    pub(crate) fn open<A: Asked>(args: &'a ScalarArgs, asked: &A, stop: &Stop) -> Result<Self> {
        let inputs = [args.file.as_path()];
        let painted = args
            .output
            .as_deref()
            .map(|path| Painted::create(A::BY, path, args.quantize, args.force, &inputs));
        let painted = painted.transpose()?;
        let svg = args.svg.as_deref().map(|path| A::SVG.create(path, args.force, &inputs)).transpose()?;
        let streams = painted.iter().filter_map(Painted::output).chain(&svg);
        let out = output::messages(streams, args.json, args.quiet)?;
        let cancel = stop.heed();
        let file = open(&args.file)?;
        // A header may claim any number of vertices; more than its leaves have there are not.
        let vertices =
            leaves(&file).into_iter().map(|leaf| u64::from(file.clusters()[leaf.index()].vertex_count));
        let normals = if A::NORMALS { SharedNormals::memory(&file) } else { 0 };
        let (vertices, shared) = (vertices.sum::<u64>(), u64::from(file.header().shared_vertex_count));
        // Sides are found before there are numbers.
        let sides = if asked.turn() == InsideOut::Auto { Sides::memory(vertices, shared) } else { 0 };
        let own = sides.max(VERTEX * vertices + 4 * shared) + normals + Memory::own(&file);
        let (pool, free) = memory::workers(&args.threads, &file, args.memory.memory(), own, Memory::THREAD)?;
        let memory = Memory::divide(Bytes(free), pool.current_num_threads());
        Ok(Scalars { args, file, painted, svg, out, pool, memory, cancel })
    }

    /// Asks each vertex.
    pub(crate) fn measure<A: Asked + Send>(&mut self, asked: &mut A) -> Result<Measured> {
        reading(&self.file, || self.cast(asked))
    }

    fn cast<A: Asked + Send>(&self, asked: &mut A) -> Result<Measured> {
        let Scalars { file, pool, cancel, .. } = self;
        let meter = Meter::new(self.args.quiet);
        let leaves = leaves(file);
        let normals = if A::NORMALS {
            meter.start("normals", leaves.len() as u64);
            let begun = |_| {
                meter.add(1);
                stop::check(cancel)
            };
            let normals = pool.install(|| SharedNormals::find(file, begun))?;
            meter.finish();
            Some(normals)
        } else {
            None
        };

        let mut caster = Caster::new(file, self.memory);
        let go_on = memory::go_on(cancel);
        let turn = asked.turn();
        let sides = if turn == InsideOut::Auto {
            meter.start("inside out", leaves.len() as u64);
            let begun = || {
                meter.add(1);
                go_on()
            };
            let sides = pool.install(|| Sides::find(&mut caster, &begun))?;
            meter.finish();
            Some(sides)
        } else {
            None
        };
        let turns = Turns { all: turn == InsideOut::Yes, sides: sides.as_ref() };

        meter.start(A::BY, leaves.len() as u64);
        let mut values: Vec<Vec<f64>> = Vec::with_capacity(leaves.len());
        let (mut rays, mut counts) = (Vec::new(), Vec::new());
        let mut next = leaves.into_iter().peekable();
        while next.peek().is_some() {
            rays.clear();
            counts.clear();
            // Leaves that lie beside each other in the file, as many as there is room for.
            for leaf in next.by_ref() {
                stop::check(cancel)?;
                let page = file.page(leaf)?;
                let page = page.view();
                let before = rays.len();
                let normals = normals.as_ref().map(|normals| turns.give(leaf, &page, normals));
                ask(asked, &page, normals.as_deref(), &mut rays);
                counts.push((page.vertex_count(), rays.len() - before));
                if rays.len() >= self.memory.rays {
                    break;
                }
            }
            let mut hits: Vec<Option<Hit>> = Vec::with_capacity(rays.len());
            pool.install(|| caster.cast(&rays, &Bound::LEAVES, A::SEEK, &go_on, |hit, _| hits.push(hit)))?;
            let mut begin = 0;
            for (vertices, count) in &counts {
                let each = count / (*vertices).max(1);
                let own = &hits[begin..begin + count];
                begin += count;
                values.push((0..*vertices).map(|v| asked.value(&own[v * each..(v + 1) * each])).collect());
            }
            meter.add(counts.len() as u64);
        }
        meter.finish();
        let parts = Parts::new(file, values)?;
        let turned = sides.map(|sides| [sides.components, sides.turned_components]);
        Ok(Measured { parts, pages: caster.reads().pages, turned })
    }

    /// Writes the colours and the histogram.
    pub(crate) fn write<A: Asked>(
        &mut self,
        parts: &Parts,
        summary: &Summary,
        note: &str,
        stop: &Stop,
    ) -> Result<()> {
        let colors = Colors::new(summary.range, false);
        if let Some(painted) = self.painted.take() {
            let file = &self.file;
            reading(file, || painted.write(A::BY, file, parts, &colors, &self.cancel))?.build(
                self.args.memory.memory(),
                self.args.quiet,
                stop,
            )?;
        }
        if let Some(mut svg) = self.svg.take() {
            let title = self.args.file.file_name().unwrap_or_default().to_string_lossy();
            svg.write_all(plot(summary, &colors, None, A::ALONG, [&title, note])?.as_bytes())?;
            svg.publish()?;
        }
        Ok(())
    }

    /// The file for programs.
    pub(crate) fn json(&self) -> near::Model {
        let header = self.file.header();
        near::Model {
            path: named(&self.args.file),
            triangles: header.source_triangle_count,
            bytes: self.file.stored_len(),
            diagonal: header.aabb().diagonal(),
        }
    }
}

/// Which normals are turned.
struct Turns<'t> {
    all: bool,
    sides: Option<&'t Sides>,
}

impl Turns<'_> {
    /// Normals of a leaf's vertices, outward.
    fn give(&self, leaf: ClusterId, page: &Page<'_>, normals: &SharedNormals) -> Vec<[f64; 3]> {
        let mut normals = normals.of_leaf(page);
        let turned = self.sides.and_then(|sides| sides.of_leaf(leaf, page));
        for (vertex, normal) in normals.iter_mut().enumerate() {
            if self.all || turned.as_ref().is_some_and(|turned| turned[vertex]) {
                *normal = normal.map(|x| -x);
            }
        }
        normals
    }
}

fn ask<A: Asked>(asked: &A, page: &Page<'_>, normals: Option<&[[f64; 3]]>, rays: &mut Vec<Ray>) {
    for (vertex, position) in page.positions.iter().enumerate() {
        let normal = normals.map_or([0.0; 3], |normals| normals[vertex]);
        asked.rays(position.map(f64::from), normal, rays);
    }
}

/// A point that was typed.
pub(crate) fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect();
    match numbers.as_deref() {
        Some([x, y, z]) => Ok([*x, *y, *z]),
        _ => Err(format!("'{text}' is no point: write x,y,z")),
    }
}

//! The command line: its verbs.

#[cfg(feature = "viewer")]
use crate::cmd::render;
#[cfg(feature = "viewer")]
use crate::cmd::view;
use crate::cmd::{
    batch, bench, build, clearance, compare, completions, config, contacts, demo, distance, dump, export,
    extract, info, measure, path, rays, relayout, report, section, simplify, stage, stats, synth, thickness,
    verify, visible, walk,
};
#[cfg(feature = "web")]
use crate::cmd::{serve, share};
use clap::{Parser, Subcommand};

/// Turns a triangle mesh ({meshes}) into one memory-mapped clustered
/// hierarchy of progressive meshes (CHPM).
#[derive(Parser, Debug)]
#[command(name = "chpm", version, after_help = AFTER_HELP)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

const AFTER_HELP: &str =
    "Exit codes: 0 success; 1 a verification found a fault; 2 error; 129, 130, 143 stopped by a signal.
Start with: chpm demo";

/// Verbs.
#[derive(Subcommand, Debug)]
pub(crate) enum Command {
    /// Build a .chpm file from a mesh
    Build(build::Args),
    /// Build many meshes into one folder; what is current is left alone
    Batch(batch::Args),
    /// Build one model in steps, on many machines
    Stage(Box<stage::Args>),
    /// Do steps of a plan that nobody else does, until all are done
    Work(stage::WorkArgs),
    /// Show what a file is, how big and how good, and what to do next
    Info(info::Args),
    /// Show how good a file is, level by level, and its worst clusters
    Stats(stats::Args),
    /// Write a page about a file: pictures, plots, a map of clusters
    Report(report::Args),
    /// Check every byte and invariant, the source's triangles, cracks
    Verify(verify::Args),
    /// Sample the distance of a file from its source, or of two meshes
    Measure(measure::Args),
    /// Find how near two models are: an interval that is proven
    Distance(distance::Args),
    /// Prove that two models are farther apart than a distance
    Clearance(clearance::Args),
    /// Find everywhere that two models, or one and itself, come near
    Contacts(contacts::Args),
    /// Find how far each vertex of a scan is from a reference
    Compare(compare::Args),
    /// Measure time, memory and deviation beside other simplifiers
    Bench(bench::Args),
    /// What `bench` runs in processes of their own
    #[command(hide = true)]
    Contend(bench::ContendArgs),
    /// Write a file anew with its pages compressed, or uncompressed
    Relayout(relayout::Args),
    /// Print the tables of a file as text, and its pages
    Dump(dump::Args),
    /// Take one mesh without cracks out of a file: PLY, STL, OBJ, glTF
    Extract(extract::Args),
    /// Cut by a plane, or by many: sections and contours as drawings
    Section(section::Args),
    /// Cast rays: what each meets, and what that proves of the source
    Rays(rays::Args),
    /// Find how thick the wall is behind each vertex
    Thickness(thickness::Args),
    /// Find which vertices can be seen from points
    Visible(visible::Args),
    /// Write the whole hierarchy, as 3D Tiles or meshlets
    Export(export::Args),
    /// Make a mesh smaller and prove how near it stays
    Simplify(simplify::Args),
    /// Make a camera path around a model
    Path(path::Args),
    /// Draw a picture of a model, or of two, without a window
    #[cfg(feature = "viewer")]
    Render(Box<render::Args>),
    /// Look at a model, or at two, in a window
    #[cfg(feature = "viewer")]
    View(Box<view::Args>),
    /// Select along a camera path, frame by frame, and count
    Walk(walk::Args),
    /// Show files in a browser: serve them and a page on this machine
    #[cfg(feature = "web")]
    Serve(serve::Args),
    /// Write a folder for a web host: a model and a page that shows it
    #[cfg(feature = "web")]
    Share(share::Args),
    /// Generate a mesh of any size
    Synth(synth::Args),
    /// Generate a model, build it, verify it: all of it once
    Demo(demo::Args),
    /// Print the settings that a build would have, and their origins
    Config(config::Args),
    /// Write a script that completes this command line in a shell
    Completions(completions::Args),
    /// Write manual pages into a folder
    Man(completions::ManArgs),
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}

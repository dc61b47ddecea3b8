//! The command line with an example or more for each verb, as `chpm help VERB` and the man pages show them.

use crate::cli::Cli;
use crate::formats;
use crate::help;
use clap::{Command, CommandFactory};
use std::fmt::Write;

/// A command line and its meaning. Tests run each of them beside `scan.ply`, what is built of it, and a folder `scans`.
type Example = (&'static str, &'static str);

const EXAMPLES: &[(&str, &[Example])] = &[
    (
        "build",
        &[
            ("chpm build scan.ply", "scan.chpm, beside it"),
            ("chpm build scan.ply -o clean.chpm --min-component 1%", "without the dust"),
            ("chpm build scan.ply -o first.chpm --preset preview", "a small file for a first look"),
            ("zcat scan.ply.gz | chpm build - -o piped.chpm", "what comes through a pipe"),
        ],
    ),
    (
        "batch",
        &[
            ("chpm batch scans -o built --dry-run", "what would be built, and why"),
            ("chpm batch scans -o built --report", "all of them, and built/index.html"),
            ("chpm batch 'scans/*.ply' -o built --jobs 2 --memory 512M", "two at a time"),
        ],
    ),
    (
        "stage",
        &[
            ("chpm stage plan scan.ply -o scan.stages --parts 2", "the first step: read, and divide"),
            ("chpm stage scatter scan.stages --part 2/2", "the next, here or on another machine"),
            (
                "chpm stage workflow scan.ply -o big.chpm --parts 4 --for slurm > big.sh",
                "all of them, for a cluster",
            ),
        ],
    ),
    (
        "work",
        &[(
            "chpm work scan.stages -o worked.chpm",
            "all steps that are left; on as many machines as there are",
        )],
    ),
    (
        "info",
        &[
            ("chpm info scan.chpm", "one screen"),
            ("chpm info scan.chpm --levels --refusals", "the levels, and what was refused"),
            ("chpm info scan.chpm --json", "all of it, for programs"),
        ],
    ),
    (
        "stats",
        &[
            ("chpm stats scan.chpm", "level by level, and the worst clusters"),
            (
                "chpm stats scan.chpm -q --assert 'acmr24<0.9' --assert 'roots==1'",
                "exit code 1 where that is not so",
            ),
            ("chpm stats scan.chpm --csv clusters.csv", "with a row for each cluster"),
        ],
    ),
    (
        "report",
        &[
            ("chpm report scan.chpm -o report.html", "a page for a browser"),
            ("chpm report scan.chpm --compare clean.chpm -o both.html", "beside another file"),
            ("chpm report scan.chpm -o - > page.html", "to a pipe or a file"),
        ],
    ),
    (
        "verify",
        &[
            ("chpm verify scan.chpm --against scan.ply", "every byte, and every triangle of the source"),
            ("chpm verify scan.chpm --cuts 100", "no crack in a hundred random cuts"),
        ],
    ),
    (
        "measure",
        &[
            ("chpm measure scan.chpm --against scan.ply --samples 1", "each level and the source"),
            ("chpm measure scan.ply small.ply", "two meshes"),
        ],
    ),
    (
        "distance",
        &[
            ("chpm distance scan.chpm small.ply --pose 20,0,0", "with the second one moved along x"),
            (
                "chpm distance scan.chpm scan.chpm --pose 20,0,0,0,0,1,1 --error 0",
                "turned about z, and exact",
            ),
        ],
    ),
    (
        "clearance",
        &[("chpm clearance scan.chpm scan.chpm --above 1% --pose 20,0,0", "exit code 0 where it is proven")],
    ),
    (
        "contacts",
        &[
            ("chpm contacts scan.chpm scan.chpm --within 0.1% --pose 0,0,0.1", "where they are near"),
            ("chpm contacts scan.chpm scan.chpm --path moves.poses --csv contacts.csv", "along a motion"),
            ("chpm contacts scan.chpm --self", "where it meets itself"),
        ],
    ),
    (
        "compare",
        &[
            (
                "chpm compare small.ply scan.chpm -o colored.ply --svg histogram.svg",
                "in colours, with a histogram",
            ),
            ("chpm compare small.ply scan.chpm -o colored.chpm", "to look at with chpm view"),
            (
                "chpm compare small.ply scan.chpm --tolerance 0.5% --html compared.html",
                "what share is near enough, as a page",
            ),
        ],
    ),
    ("bench", &[("chpm bench scan.ply --only chpm --runs 1 --csv speed.csv", "time, memory and deviation")]),
    ("relayout", &[("chpm relayout scan.chpm -o packed.chpm --pages packed", "the same in fewer bytes")]),
    (
        "dump",
        &[
            ("chpm dump scan.chpm | head -20", "the tables"),
            ("chpm dump scan.chpm --cluster 3 | head", "one cluster with its triangles"),
        ],
    ),
    (
        "extract",
        &[
            ("chpm extract scan.chpm --triangles 10% -o tenth.ply", "by triangles"),
            ("chpm extract scan.chpm --error 0.1% -o near.ply", "by distance from the source"),
            ("chpm extract scan.chpm --triangles 20k -o small.glb --meshopt", "for the web, compressed"),
            ("chpm extract scan.chpm --lods 50%,20%,5% -o levels.glb", "levels of detail for engines"),
            ("chpm extract scan.chpm --level 1 -o - > level.ply", "to a pipe or a file"),
            ("chpm extract scan.chpm --level 0 --order cache-oblivious -o o.ply", "for caches of any size"),
        ],
    ),
    (
        "section",
        &[
            (
                "chpm section scan.chpm --plane 0,0,1:0.5 -o plan.svg",
                "a plan at the height of half a unit, to scale",
            ),
            (
                "chpm section scan.chpm --plane 1,0,0:0 --unit m --scale 1:50 -o profile.svg",
                "a profile of a model in metres",
            ),
            (
                "chpm section scan.chpm --every 0.1 --axis z -o contours.dxf",
                "contours, a layer for each height",
            ),
            (
                "chpm section scan.chpm --every 0.1 --origin 13.4,52.5,34 -o contours.geojson",
                "in longitude and latitude",
            ),
        ],
    ),
    (
        "rays",
        &[
            ("chpm rays scan.chpm rays.csv -o hits.csv", "what each ray of a file meets first"),
            ("chpm rays scan.chpm rays.csv --error 0.1% --any --json", "how many certainly meet nothing"),
        ],
    ),
    (
        "thickness",
        &[
            ("chpm thickness scan.chpm -o walls.ply --svg walls.svg", "in colours, with a histogram"),
            ("chpm thickness scan.chpm --cone 0 --json", "along the normals alone"),
        ],
    ),
    (
        "visible",
        &[(
            "chpm visible scan.chpm --from 0,0,2 --from 3,0,2 -o seen.ply",
            "from which points each vertex is seen",
        )],
    ),
    (
        "simplify",
        &[
            (
                "chpm simplify scan.ply --within 0.1% -o near.glb",
                "neither is farther from the other than that",
            ),
            ("chpm simplify scan.ply --within 1mm --unit m -o near.stl", "of a model in metres"),
        ],
    ),
    (
        "export",
        &[
            ("chpm export scan.chpm --3dtiles tiles", "for CesiumJS and 3d-tiles-renderer"),
            (
                "chpm export scan.chpm --3dtiles placed --origin 13.4,52.5,34 --meshopt",
                "somewhere in Berlin, compressed",
            ),
            ("chpm export scan.chpm --3dtiles scan.3tz", "one file instead of a folder"),
            ("chpm export scan.chpm --meshlets scan.meshlets", "for mesh shaders"),
        ],
    ),
    ("path", &[("chpm path orbit scan.chpm --frames 60 -o orbit.path", "once around it")]),
    (
        "render",
        &[
            (
                "chpm render scan.chpm -o clusters.png --color cluster --viewport 320x240",
                "a picture of the clusters",
            ),
            (
                "chpm render scan.chpm -o inside.png --clip 1,1,0:0.2 --roll 10 --light -60,20",
                "what is behind a plane, leaning, lit from the left",
            ),
            (
                "chpm render scan.chpm -o still.png --rays --ground --light 60,30 --viewport 320x240",
                "without a GPU, with soft shadows, on a ground",
            ),
            (
                "chpm render scan.chpm small.ply --pose 20,0,0 -o both.png --viewport 320x240",
                "two models, the second one moved along x",
            ),
        ],
    ),
    (
        "serve",
        &[
            ("chpm serve scan.chpm", "at the address that it prints"),
            ("chpm serve models --list --port 8080", "those of a folder"),
        ],
    ),
    (
        "share",
        &[
            ("chpm share scan.chpm -o site", "to be put on any host of static files"),
            (
                "chpm share scan.ply -o bust --split --title Bust",
                "the same for one without range requests, as a museum shows it",
            ),
        ],
    ),
    (
        "view",
        &[
            ("chpm view scan.chpm", "a window"),
            ("chpm view scan.ply", "a mesh, which is built first"),
            ("chpm view scan.chpm scan.chpm --pose 20,0,0 --within 5%", "two, and where they are near"),
        ],
    ),
    (
        "walk",
        &[
            ("chpm walk scan.chpm dive.path", "what selection does along a path"),
            ("chpm walk scan.chpm dive.path --csv frames.csv", "frame by frame"),
        ],
    ),
    (
        "synth",
        &[
            ("chpm synth terrain --triangles 100k -o terrain.ply", "a terrain"),
            ("chpm synth --list", "what there is"),
        ],
    ),
    (
        "demo",
        &[
            ("chpm demo --triangles 20k", "all of it once"),
            ("chpm demo --triangles 20k --keep demo", "the same, and the files stay"),
        ],
    ),
    (
        "config",
        &[
            ("chpm config scan.ply", "what a build of it would have, and from where"),
            ("chpm config --preset isosurface --pages raw", "a preset, and what is typed besides"),
        ],
    ),
    ("completions", &[("chpm completions bash > chpm.bash", "to be sourced; zsh, fish, elvish, powershell")]),
    ("man", &[("chpm man man1", "a page for each verb: man -l man1/chpm-build.1")]),
];

/// The command line.
pub(crate) fn command() -> Command {
    help::grouped(EXAMPLES.iter().fold(formats::named(Cli::command()), with_examples))
}

/// The command with examples for one verb: all in its long help, the first two in the short one.
fn with_examples(command: Command, (verb, examples): &(&'static str, &[Example])) -> Command {
    // Without the viewer two of them are not there.
    if command.find_subcommand(verb).is_none() {
        return command;
    }
    let more = format!("\nAll options: chpm help {verb}");
    let short = text(&examples[..examples.len().min(2)]) + &more;
    command.mut_subcommand(*verb, |verb| verb.after_help(short).after_long_help(text(examples)))
}

fn text(examples: &[Example]) -> String {
    let mut text = "Examples:".to_owned();
    for (typed, does) in examples {
        let _ = write!(text, "\n  # {does}\n  {typed}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_verb_has_examples_that_are_understood() {
        command().debug_assert();
        for verb in command().get_subcommands().filter(|verb| !verb.is_hide_set()) {
            let found = EXAMPLES.iter().find(|(name, _)| *name == verb.get_name());
            let (_, examples) = found.unwrap_or_else(|| panic!("{} has no example", verb.get_name()));
            for (typed, _) in *examples {
                let own = typed.split(['|', '&', '>']).map(str::trim).find(|part| part.starts_with("chpm "));
                let words =
                    own.expect("a call of chpm").split_whitespace().map(|word| word.trim_matches('\''));
                command().try_get_matches_from(words).unwrap_or_else(|error| panic!("{typed}: {error}"));
            }
        }
    }
}

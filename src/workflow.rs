//! The steps of a build as a workflow for an engine: Snakemake, Slurm, HyperQueue.

use crate::cmd::word;
use crate::escape::{escaped, in_line};
use anyhow::{Result, bail};
use chpm_build::stage::{Share, Step};
use chpm_mesh::Bytes;
use clap::ValueEnum;
use std::fmt::Write;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

/// Engines that a workflow is written for.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Engine {
    /// A Snakefile: on this machine, and by its executor plugins on clusters and in clouds
    Snakemake,
    /// A shell script of `sbatch`: arrays of jobs that depend on one another
    Slurm,
    /// A shell script of `hq submit`: arrays of tasks, one after another
    Hyperqueue,
}

/// A build that is to be written down.
pub(crate) struct Workflow {
    /// The mesh, or tiles of one, and how near vertices of different tiles are joined.
    pub(crate) sources: Vec<PathBuf>,
    pub(crate) weld: Option<f64>,
    pub(crate) folder: PathBuf,
    pub(crate) output: PathBuf,
    pub(crate) parts: u32,
    pub(crate) levels: u32,
    /// Resources of each command.
    pub(crate) threads: u32,
    pub(crate) memory: Bytes,
    /// Settings for the plan, word by word.
    pub(crate) settings: Vec<String>,
    /// Triangles of the source, about.
    pub(crate) triangles: u64,
}

/// Steps that can be done side by side: one, or all parts of something.
struct Phase {
    name: String,
    first: Step,
    is_parted: bool,
}

/// Triangles a second on one processor in all steps together, and how that is shared among them.
const RATE: f64 = 300_000.0;
const SHARES: [(&str, f64); 6] =
    [("plan", 0.1), ("scatter", 0.05), ("regions", 0.15), ("simplify", 0.5), ("emit", 0.05), ("", 0.05)];
/// Bytes that a step leaves for each triangle of the source.
const BYTES: [(&str, f64); 6] = [
    ("plan", 22.0),
    ("scatter", 14.0),
    ("regions", 22.0),
    ("simplify", 60.0),
    ("emit", 50.0),
    ("finish", 50.0),
];

impl Workflow {
    /// The text for an engine.
    ///
    /// # Errors
    /// A name that the engine would read as another one.
    pub(crate) fn text(&self, engine: Engine) -> Result<String> {
        for path in self.sources.iter().chain([&self.output]) {
            let shown = path.display();
            // Such characters do not come through the shell, a terminal or an editor as they are.
            if path.to_str().is_none_or(|text| escaped(text) != text) {
                bail!("'{shown}' has characters in its name that a script cannot hold; rename it");
            }
            if engine == Engine::Snakemake && shown.to_string().contains(['{', '}']) {
                bail!(
                    "'{shown}' has braces in its name, which Snakemake takes for a wildcard; rename it, or write the workflow for another engine"
                );
            }
        }
        Ok(match engine {
            Engine::Snakemake => self.snakemake(),
            Engine::Slurm => self.slurm(),
            Engine::Hyperqueue => self.hyperqueue(),
        })
    }

    fn phases(&self) -> Vec<Phase> {
        let one = |name: &str, first| Phase { name: name.to_owned(), first, is_parted: false };
        let share = Share { index: 1, of: self.parts };
        let all = |name: &str, first| Phase { is_parted: true, ..one(name, first) };
        let mut phases = vec![
            one("plan", Step::Plan),
            all("scatter", Step::Scatter(share)),
            one("borders", Step::Borders),
            all("regions", Step::Regions(share)),
            one("hierarchy", Step::Hierarchy),
        ];
        for level in 0..self.levels {
            phases.push(one(&format!("group_{level}"), Step::Group(level)));
            phases.push(all(&format!("simplify_{level}"), Step::Simplify(level, share)));
        }
        phases.extend([
            one("simplify_rest", Step::Top(self.levels)),
            one("layout", Step::Layout),
            all("emit", Step::Emit(share)),
            one("finish", Step::Finish),
        ]);
        phases
    }

    /// The command of a phase; `index` stands for the number of the part.
    fn command(&self, phase: &Phase, index: &str) -> String {
        let folder = word(&slashed(&self.folder));
        let resources = format!("--threads {} --memory {} --quiet", self.threads, size(self.memory));
        match phase.first {
            Step::Plan => {
                let settings: String =
                    self.settings.iter().map(|setting| format!(" {}", word_of(setting))).collect();
                let sources: String =
                    self.sources.iter().map(|source| word(&slashed(source)) + " ").collect();
                let weld = self.weld.map_or(String::new(), |weld| format!(" --weld {weld}"));
                let Workflow { parts, levels, .. } = self;
                format!(
                    "stage plan {sources}-o {folder}{weld} --parts {parts} --levels {levels}{settings} {resources}"
                )
            }
            Step::Finish => {
                format!("stage finish {folder} -o {} --force {resources}", word(&slashed(&self.output)))
            }
            step => {
                let (before, behind) = step.words();
                let behind =
                    if phase.is_parted { behind.replace(" 1/", &format!(" {index}/")) } else { behind };
                format!("stage {before} {folder}{behind} {resources}")
            }
        }
    }

    /// Minutes and MiB of disk that a step of a phase takes, about.
    fn takes(&self, phase: &Phase) -> (u64, u64) {
        let kind = phase.name.split('_').next().unwrap_or_default();
        let find =
            |rows: &[(&str, f64)]| rows.iter().find(|(name, _)| *name == kind).map(|(_, value)| *value);
        // Each level has half the triangles of the one below.
        let level = match phase.first {
            Step::Simplify(level, _) => 0.5_f64.powi(level as i32 + 1),
            Step::Top(level) => 0.5_f64.powi(level as i32),
            _ => 1.0,
        };
        let parts = if phase.is_parted { f64::from(self.parts) } else { 1.0 };
        let triangles = self.triangles as f64 * level / parts;
        let seconds = triangles / RATE * find(&SHARES).unwrap_or(SHARES[5].1);
        // Twice what is expected, and at least a little: what an engine stops is done again.
        let minutes = 2.0 * seconds / 60.0 / f64::from(self.threads.min(4));
        (minutes.ceil() as u64 + 2, (find(&BYTES).unwrap_or(1.0) * triangles / 1048576.0).ceil() as u64 + 16)
    }

    fn head(&self, how: &str) -> String {
        format!(
            "# Builds {} from {} in {} parts, {} levels of which are simplified in parts: about {} triangles.\n#\n{how}\n",
            in_line(&self.output.display().to_string()),
            match self.sources.as_slice() {
                // A line break would end the comment.
                [one] => in_line(&one.display().to_string()).into_owned(),
                several => format!("{} tiles", several.len()),
            },
            self.parts,
            self.levels,
            self.triangles
        )
    }

    fn snakemake(&self) -> String {
        let mut text = self.head(
            "#   snakemake -s THIS --cores 4\n#\n# Here that runs on this machine; with an executor plugin and a profile of yours the same file runs on a cluster, where all\n\
             # must see the source and the folder. What is there is not made again. A part that is damaged is named: delete it.",
        );
        let path = |path: &Path| quoted(&slashed(path).display().to_string());
        let at = |name: String| path(&self.folder.join(name));
        let file = |step: Step| match step {
            Step::Finish => path(&self.output),
            step => at(step.file()),
        };
        let _ = writeln!(
            text,
            "CHPM = config.get(\"chpm\", \"chpm\")\n\nrule all:\n    input: {}\n",
            file(Step::Finish)
        );
        for phase in self.phases() {
            let inputs: Vec<String> = match phase.first {
                Step::Plan => self.sources.iter().map(|source| path(source)).collect(),
                step => step.inputs(self.parts, self.levels).into_iter().map(file).collect(),
            };
            let name = &phase.name;
            let output = match phase.is_parted {
                true => at(phase.first.file().replace("-1-of-", "-{i}-of-")),
                false => file(phase.first),
            };
            let (minutes, disk) = self.takes(&phase);
            let command = self.command(&phase, "{wildcards.i}");
            let command = match phase.is_parted {
                true => command,
                false => command.replace('{', "{{").replace('}', "}}"),
            };
            let _ = writeln!(
                text,
                "rule {name}:\n    input:\n        {}\n    output: {output}\n    threads: {}\n    resources: mem_mb={}, runtime={minutes}, disk_mb={disk}\n    shell: {}\n",
                inputs.join(",\n        "),
                self.threads,
                self.memory.0 >> 20,
                quoted(&format!("{{CHPM}} {command}")),
            );
        }
        text
    }

    fn slurm(&self) -> String {
        let mut text = self.head(
            "#   bash THIS\n#\n# Each phase waits for the one before; jobs of an array run side by side. Where one has failed, delete the part that it names and run\n\
             # this again: what is there is not made again. $CHPM is the program, $SBATCH_OPTIONS what your cluster wants besides.",
        );
        text.push_str("set -euo pipefail\nCHPM=\"${CHPM:-chpm}\"\nbefore=\n");
        for phase in self.phases() {
            let (minutes, disk) = self.takes(&phase);
            let array = if phase.is_parted { format!(" --array=1-{}", self.parts) } else { String::new() };
            let command = self.command(&phase, "$SLURM_ARRAY_TASK_ID");
            let _ = writeln!(
                text,
                "before=$(sbatch --parsable ${{SBATCH_OPTIONS:-}} ${{before:+--dependency=afterok:$before}} --job-name={}{array} --cpus-per-task={} --mem={}M --time={minutes} --tmp={disk}M \\\n    --wrap \"$CHPM \"{})",
                phase.name,
                self.threads,
                self.memory.0 >> 20,
                word_of(&command),
            );
        }
        text.push_str("echo \"the last job is $before\"\n");
        text
    }

    fn hyperqueue(&self) -> String {
        let mut text = self.head(
            "#   hq server start &   hq worker start &   bash THIS\n#\n# Each phase waits for the one before; tasks of an array run side by side. Where one has failed, delete the part that it names\n\
             # and run this again: what is there is not made again. $CHPM is the program.",
        );
        text.push_str("set -euo pipefail\nCHPM=\"${CHPM:-chpm}\"\n");
        for phase in self.phases() {
            let (minutes, _) = self.takes(&phase);
            let array = if phase.is_parted { format!(" --array=1-{}", self.parts) } else { String::new() };
            let _ = writeln!(
                text,
                "hq submit --wait --name={}{array} --cpus={} --resource=\"mem={}\" --time-limit={minutes}min -- \\\n    sh -c \"$CHPM \"{}",
                phase.name,
                self.threads,
                self.memory.0 >> 20,
                word_of(&self.command(&phase, "$HQ_TASK_ID")),
            );
        }
        text
    }
}

/// Memory as it is typed.
fn size(memory: Bytes) -> String {
    format!("{}M", memory.0 >> 20)
}

/// A path with the separators that all systems read: what is written in Windows runs on clusters.
fn slashed(path: &Path) -> PathBuf {
    path.display().to_string().replace(MAIN_SEPARATOR, "/").into()
}

/// A text as a word of the shell.
fn word_of(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// A text as a string of Python.
fn quoted(text: &str) -> String {
    let text = text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n").replace('\t', "\\t");
    format!("\"{text}\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn workflow() -> Workflow {
        Workflow {
            sources: vec!["a scan's.ply".into(), "b.ply".into()],
            weld: Some(0.25),
            folder: "w.stages".into(),
            output: "w.chpm".into(),
            parts: 3,
            levels: 2,
            threads: 2,
            memory: Bytes::mib(512),
            settings: vec!["--keep".to_owned(), "it's".to_owned()],
            triangles: 10_000_000,
        }
    }

    #[test]
    fn every_step_is_in_each_text_once() {
        for engine in [Engine::Snakemake, Engine::Slurm, Engine::Hyperqueue] {
            let text = workflow().text(engine).expect("a text");
            for step in [
                "stage plan",
                "stage scatter",
                "stage borders",
                "regions",
                "hierarchy",
                "--level 0",
                "--level 1",
                "--from-level 2",
                "emit",
                "finish",
            ] {
                assert!(text.contains(step), "{step}: {text}");
            }
            assert_eq!(text.matches("stage simplify").count(), 3, "{text}");
        }
    }

    #[test]
    fn scripts_of_the_shell_are_understood_and_ask_for_each_phase() {
        // A stand-in for the engine prints what it is asked for.
        for (engine, program) in [(Engine::Slurm, "sbatch"), (Engine::Hyperqueue, "hq")] {
            let text = workflow().text(engine).expect("a text");
            let script = format!("{program}() {{ printf '%s|' \"$@\" >&2; echo >&2; echo 7; }}\n{text}");
            let run = std::process::Command::new("bash").args(["-c", &script]).output().expect("bash");
            let told = String::from_utf8_lossy(&run.stderr);
            assert!(run.status.success(), "{told}");
            assert_eq!(told.lines().count(), 13, "{told}");
            assert!(
                told.contains("a scan'\\''s.ply")
                    && told.contains("'b.ply' -o 'w.stages' --weld 0.25")
                    && told.contains("it'\\''s"),
                "{told}"
            );
            assert!(told.contains("_TASK_ID/3"), "{told}");
        }
    }

    /// All that a name may have which means something to a shell or to Python.
    const ODD: &str = "a\n$(touch b) 'c' \"d\" \\e $HOME `f`\t-1-of-4.ply";

    fn odd() -> Workflow {
        let folder = PathBuf::from(ODD).with_extension("stages");
        Workflow {
            sources: vec![ODD.into()],
            weld: None,
            output: format!("{ODD}.chpm").into(),
            folder,
            ..workflow()
        }
    }

    #[test]
    fn names_come_through_the_shell_as_they_are() {
        for (engine, stand_in) in [
            (Engine::Slurm, "sbatch() { for last; do :; done; sh -c \"$last\" >&2; echo 7; }"),
            (Engine::Hyperqueue, "hq() { while [ \"$1\" != -- ]; do shift; done; shift; \"$@\" >&2; }"),
        ] {
            let text = odd().text(engine).expect("a text");
            let comments = text.split("set -euo").next().unwrap_or_default();
            assert!(comments.lines().all(|line| line.starts_with('#')), "{comments}");
            let run = std::process::Command::new("bash")
                .env("CHPM", "printf [%s]")
                .args(["-c", &format!("{stand_in}\n{text}")])
                .output()
                .expect("bash");
            let told = String::from_utf8_lossy(&run.stderr);
            assert!(run.status.success(), "{told}");
            let folder = odd().folder.display().to_string();
            assert!(told.contains(&format!("[stage][plan][{ODD}][-o][{folder}]")), "{told}");
            assert!(told.contains(&format!("[finish][{folder}][-o][{ODD}.chpm]")), "{told}");
            assert_eq!(told.matches(&format!("[{folder}]")).count(), 13, "{told}");
        }
    }

    #[test]
    fn names_come_through_a_snakefile_as_they_are() {
        let text = odd().text(Engine::Snakemake).expect("a text");
        // Strings of Python with these escapes are those of JSON.
        let strings: Vec<String> = text
            .lines()
            .filter_map(|line| line.trim_start_matches(|c| c != '"').trim_end_matches(',').into())
            .filter_map(|string: &str| serde_json::from_str(string).ok())
            .collect();
        let folder = odd().folder.display().to_string();
        assert!(strings.contains(&ODD.to_owned()) && strings.contains(&format!("{ODD}.chpm")), "{text}");
        for name in
            ["scatter-{i}-of-3.part", "scatter-2-of-3.part", "simplify-1-{i}-of-3.part", "borders.part"]
        {
            assert!(strings.contains(&format!("{folder}/{name}")), "{name}: {text}");
        }
        for line in text.lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
            let starts = ["CHPM = ", "rule ", "    "];
            assert!(starts.iter().any(|start| line.starts_with(start)), "{line}");
        }
        let folders = strings
            .iter()
            .filter(|string| string.starts_with("{CHPM} stage ") && string.contains("{wildcards.i}/3"));
        assert_eq!(folders.count(), 5, "{text}");
    }

    #[test]
    fn names_that_an_engine_would_change_are_refused() {
        for (engine, name, told) in [
            (Engine::Snakemake, "a{b}.ply", "braces"),
            (Engine::Snakemake, "a\r.ply", "rename"),
            (Engine::Slurm, "a\u{1b}[31m.ply", "rename"),
            (Engine::Hyperqueue, "a\u{202e}.ply", "rename"),
        ] {
            let refused = Workflow { sources: vec![name.into()], ..workflow() }.text(engine);
            let refused = refused.expect_err(name).to_string();
            assert!(refused.contains(told), "{refused}");
        }
        for engine in [Engine::Slurm, Engine::Hyperqueue] {
            let text = Workflow { sources: vec!["a{b}.ply".into()], ..workflow() }.text(engine);
            assert!(text.expect("a text").contains("a{b}.ply"));
        }
    }
}

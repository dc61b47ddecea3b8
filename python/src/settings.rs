//! Settings of a build by the names of the command's options, as Python says them.

use crate::error::Failure;
use chpm_build::config::{Bounds, Layout, MissingImages, Normals, Texture, Topology};
use chpm_build::{BuildConfig, MIN_MEMORY, Resources, Settings};
use chpm_format::BoundaryMode;
use chpm_mesh::{Bytes, MemorySize};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Display;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

/// What was given, by name. Nothing is passed over: what no one has asked for is an error.
struct Given<'py>(Bound<'py, PyDict>);

fn refused(name: &str, told: impl Display) -> Failure {
    Failure::Asked(format!("{name}: {told}"))
}

impl Given<'_> {
    /// Takes a value; none if it was not given, or given as None.
    fn take<T>(
        &self,
        name: &str,
        of: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Result<Option<T>, Failure> {
        let Some(value) = self.0.get_item(name)? else { return Ok(None) };
        self.0.del_item(name)?;
        if value.is_none() {
            return Ok(None);
        }
        let got = || value.repr().map_or_else(|_| "?".to_owned(), |text| text.to_string());
        of(&value).map(Some).map_err(|_| refused(name, format_args!("not understood: {}", got())))
    }

    /// A value that is read from its text, as the command reads it.
    fn parsed<T: FromStr<Err: Display>>(&self, name: &str) -> Result<Option<T>, Failure> {
        let text = self.take(name, |value| Ok(value.str()?.to_string()))?;
        text.map(|text| text.parse().map_err(|error| refused(name, error))).transpose()
    }

    /// One of some words.
    fn word<T: Copy>(&self, name: &str, words: &[(&str, T)]) -> Result<Option<T>, Failure> {
        let Some(got) = self.take(name, |value| value.extract::<String>())? else { return Ok(None) };
        let found = words.iter().find(|(word, _)| *word == got).map(|(_, meant)| *meant);
        let all = || words.iter().map(|(word, _)| format!("'{word}'")).collect::<Vec<_>>().join(", ");
        found.map(Some).ok_or_else(|| refused(name, format_args!("one of {} expected, got '{got}'", all())))
    }

    fn is_set(&self, name: &str) -> Result<bool, Failure> {
        Ok(self.take(name, |value| value.extract::<bool>())?.unwrap_or(false))
    }
}

/// The configuration of a build.
pub(crate) fn build_config(given: &Bound<'_, PyDict>) -> Result<BuildConfig, Failure> {
    let given = Given(given.copy()?);
    let (settings, resources) = (settings(&given)?, resources(&given)?);
    let mut config = BuildConfig { settings, resources, overwrite: given.is_set("force")? };
    let earlier = given.take("update", |value| value.extract::<PathBuf>())?;
    if given.is_set("updatable")? || earlier.is_some() {
        if config.resources.checkpoint.is_some() {
            return Err(refused("updatable", "such a build is not gone on with: leave out resume"));
        }
        config.make_updatable(earlier);
    }
    if let Some(name) = given.0.keys().iter().next() {
        return Err(refused(
            &name.to_string(),
            "there is no such setting; their names are those of `chpm build --help`, without presets, traces and what is said about how a model is shown",
        ));
    }
    Ok(config)
}

/// One name, or several.
fn names(value: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    value.extract::<String>().map(|name| vec![name]).or_else(|_| value.extract())
}

fn settings(given: &Given<'_>) -> Result<Settings, Failure> {
    let mut settings = Settings::default();
    if let Some(count) = given.take("cluster_triangles", |value| value.extract::<u32>())? {
        if !(16..=16_384).contains(&count) {
            return Err(refused("cluster_triangles", format_args!("16 to 16384 expected, got {count}")));
        }
        (settings.cluster_triangles, settings.fewer_for_texels) = (count, false);
    }

    if let Some(partitioner) = given.parsed("partitioner")? {
        settings.partitioner = partitioner;
    }
    let boundaries = [("lock", BoundaryMode::Lock), ("dependencies", BoundaryMode::Dependencies)];
    if let Some(boundary) = given.word("boundary", &boundaries)? {
        settings.boundary = boundary;
    }
    if let Some(topology) =
        given.word("topology", &[("keep", Topology::Keep), ("change", Topology::Change)])?
    {
        settings.topology = topology;
    }

    settings.finest_error = given.parsed("finest_error")?;
    settings.target_error = given.parsed("target_error")?;
    settings.min_component = given.parsed("min_component")?;
    if let Some(seed) = given.take("seed", |value| value.extract::<u64>())? {
        settings.seed = seed;
    }

    let normals = [("source", Normals::Source), ("computed", Normals::Computed), ("none", Normals::None)];
    if let Some(normals) = given.word("normals", &normals)? {
        settings.normals = normals;
    }
    if let Some(colors) = given.take("colors", |value| value.extract::<bool>())? {
        settings.colors = colors;
    }
    if let Some(texture) = given.word(
        "texture",
        &[("none", Texture::None), ("vertices", Texture::Vertices), ("sheets", Texture::Sheets)],
    )? {
        settings.texture = texture;
    }
    let missing = [("grey", MissingImages::Grey), ("refuse", MissingImages::Refuse)];
    if let Some(missing) = given.word("missing_images", &missing)? {
        settings.missing_images = missing;
    }
    if let Some(names) = given.take("keep", names)? {
        settings.scalars = names.into();
    }
    settings.drop_invalid = given.is_set("drop_invalid")?;

    let orders = [
        ("vertex-cache", Layout::VertexCache),
        ("cache-oblivious", Layout::CacheOblivious),
        ("simplification", Layout::Simplification),
    ];
    if let Some(layout) = given.word("order", &orders)? {
        settings.layout = layout;
    }
    if let Some(bounds) = given.word("bounds", &[("quick", Bounds::Quick), ("tight", Bounds::Tight)])? {
        settings.bounds = bounds;
    }
    let pages = [("raw", (false, false)), ("packed", (true, false)), ("chained", (true, true))];
    if let Some(pages) = given.word("pages", &pages)? {
        (settings.packed, settings.chained) = pages;
    }
    if let Some(volumes) = given.parsed("volume_size")? {
        settings.volumes = volumes;
    }
    if let Some(positions) = given.parsed("positions")? {
        settings.positions = positions;
    }
    Ok(settings)
}

fn resources(given: &Given<'_>) -> Result<Resources, Failure> {
    let threads = threads(given.take("threads", |value| value.extract::<u32>())?)?;
    let mut resources = Resources { threads, ..Resources::default() };
    if let Some(memory) = given.parsed::<MemorySize>("memory")? {
        let least = MemorySize(Bytes(MIN_MEMORY));
        if memory < least {
            let told = format_args!("{memory} is less than a build can stay below: give it {least} or more");
            return Err(refused("memory", told));
        }
        resources.memory = memory.0;
    }
    resources.work_dir = given.take("work_dir", |value| value.extract::<PathBuf>())?;
    // An interrupt leaves nothing behind, unless work is to be gone on with.
    let every = resources.checkpoint;
    resources.checkpoint = if given.is_set("resume")? { every } else { None };
    if let Some(seconds) = given.take("checkpoint", |value| value.extract::<f64>())? {
        let duration = Duration::try_from_secs_f64(seconds).map_err(|error| refused("checkpoint", error))?;
        resources.checkpoint = resources.checkpoint.map(|_| duration);
    }
    Ok(resources)
}

/// Worker threads; one for each processor where none is told, which is the library's zero.
pub(crate) fn threads(told: Option<u32>) -> Result<usize, Failure> {
    match told {
        Some(count @ 1..=1024) => Ok(count as usize),
        Some(count) => Err(refused("threads", format_args!("1 to 1024 expected, got {count}"))),
        None => Ok(0),
    }
}

/// Threads for one call, and no more: those of a pool that stays would be missing in a process that was forked from this one.
pub(crate) fn pool(threads: Option<u32>) -> Result<rayon::ThreadPool, Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(self::threads(threads)?).build();
    pool.map_err(|error| Failure::Asked(format!("cannot start threads: {error}")))
}

/// A size of memory, as in `"4G"`, or a number of bytes.
pub(crate) fn memory(told: &Bound<'_, PyAny>) -> Result<Bytes, Failure> {
    let size: MemorySize = told.str()?.to_string().parse().map_err(|error| refused("memory", error))?;
    Ok(size.0)
}

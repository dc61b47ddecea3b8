//! Errors of a build.

use crate::progress::Stage;
use crate::report::Reached;
use chpm_extmem::Cancelled;
use chpm_import::SourceError;
use std::path::PathBuf;

/// Reasons why a build stops. Nothing is left behind when it does, unless it is [`BuildError::Kept`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The source cannot be read.
    #[error(transparent)]
    Source(Box<SourceError>),
    /// A scalar that is to be kept is not there.
    #[error("{path}: no scalar '{name}' to keep, of one type for all vertices; leave --keep {name} out")]
    NoScalar {
        /// The source file.
        path: PathBuf,
        /// The name that was asked for.
        name: String,
    },
    /// An image of the source cannot be read.
    #[error("{image}: {reason}; or leave textures out with --texture none")]
    Image {
        /// The source file and the image.
        image: String,
        /// Cause.
        reason: String,
    },
    /// Sheets do not go with a setting.
    #[error(
        "--texture sheets does not go with {setting} yet; leave one of the two out, or take --texture vertices"
    )]
    NoSheets {
        /// The other one, as the command has it.
        setting: &'static str,
    },
    /// Colours are asked for, and left out.
    #[error(
        "--texture {texture} gives vertices colours, and --no-colors leaves them out; leave one of the two out"
    )]
    NoColors {
        /// How images are used, as the command has it.
        texture: &'static str,
    },
    /// The source has no triangle that could be built.
    #[error("{path}: {}: nothing was written", nothing(*faces, left_out))]
    Empty {
        /// The source file.
        path: PathBuf,
        /// Faces that the header declares.
        faces: u64,
        /// Losses of the reader, in words: what it has in place of faces.
        left_out: Vec<String>,
    },
    /// All components are smaller than was asked for.
    #[error(
        "{path}: {}: nothing was written; give --min-component {largest:?} or less",
        all_small(*components, *least, *largest)
    )]
    AllSmall {
        /// The source file.
        path: PathBuf,
        /// How many there are.
        components: u64,
        /// The size that was asked for, object units.
        least: f64,
        /// That of the largest component, object units.
        largest: f64,
    },
    /// Memory, disk or file system.
    #[error(transparent)]
    Extmem(#[from] chpm_extmem::ExtmemError),
    /// The partitioner failed.
    #[error("cannot partition: {0}")]
    Partition(#[from] chpm_partition::PartitionError),
    /// Something that is no volume has the name of one.
    #[error("'{}' has the name of a volume of the model, and is something else; move it, or choose another name for the model", path.display())]
    NoVolume {
        /// The file that is there.
        path: PathBuf,
    },
    /// Volumes are so small that there would be too many files.
    #[error(
        "--volume-size {size} would take more than {most} files at a time while they are written; give it more"
    )]
    TooManyVolumes {
        /// Their size, bytes.
        size: u64,
        /// Most files.
        most: u64,
    },
    /// More vertices are shared than a file can number.
    #[error(
        "pieces of the model share more than {most} vertices, which is all that a file numbers; larger clusters share fewer: raise --cluster-triangles, or build the model in pieces"
    )]
    TooManyShared {
        /// Most of them.
        most: u64,
    },
    /// The file that is being written would not be valid.
    #[error("cannot write the file: {0}")]
    Format(#[from] chpm_format::FormatError),
    /// A part that another process is to go on with cannot be written or understood.
    #[error("a part cannot be written or understood: {0}")]
    Record(String),
    /// A part of a build in stages is not there, or is not what is needed.
    #[error("'{}' {reason}; {remedy}", path.display())]
    Part {
        /// The part.
        path: PathBuf,
        /// Reason, in words.
        reason: String,
        /// Remedy, in words.
        remedy: String,
    },
    /// The threads could not be started.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// Why not.
        reason: String,
    },
    /// The finest error that is asked for is above the coarsest.
    #[error(
        "detail below an error of {finest} is to be left out, and everything above {coarsest}: nothing would be left; raise the target error or lower the finest"
    )]
    ErrorRange {
        /// The error below which detail is left out, object units.
        finest: f32,
        /// The largest error that a mesh may have, object units.
        coarsest: f32,
    },
    /// The source is not what it was when the build began.
    #[error("{path} has changed while it was read; run the build again")]
    SourceChanged {
        /// The file that changed.
        path: PathBuf,
    },
    /// The build ended early, and can go on.
    #[error("{error}; what was done is kept up to {reached} in '{}', and the same command goes on there", folder.display())]
    Kept {
        /// Cause.
        error: Box<BuildError>,
        /// Progress that the next run goes on from.
        reached: Reached,
        /// Where that is.
        folder: PathBuf,
    },
    /// The work directory was removed during the build, which is what ended it, or what lets nothing be kept.
    #[error("{error}; the work folder '{}' was removed meanwhile, so nothing is kept: run the build again", folder.display())]
    WorkRemoved {
        /// Cause.
        error: Box<BuildError>,
        /// Folder that is gone.
        folder: PathBuf,
    },
    /// The output would replace what it is built from.
    #[error("the output '{path}' is the source itself, or a file of it; name another")]
    OutputIsSource {
        /// The output.
        path: PathBuf,
    },
    /// Someone asked to stop.
    #[error("stopped on request; nothing was written")]
    Cancelled,
    /// A limit of the format is exceeded.
    #[error("{stage}: {what} is {got}, more than the format's {limit}")]
    Limit {
        /// Where it was found.
        stage: Stage,
        /// Name of the quantity that is too large.
        what: &'static str,
        /// How much there is.
        got: u64,
        /// How much there may be.
        limit: u64,
    },
}

fn all_small(components: u64, least: f64, largest: f64) -> String {
    match components {
        1 => format!("its only component measures {largest:?} across, less than {least:?}"),
        _ => format!(
            "all {components} components are smaller than {least:?}: the largest measures {largest:?} across"
        ),
    }
}

fn nothing(faces: u64, left_out: &[String]) -> String {
    let told = match faces {
        0 => "no faces; there is nothing to build from".to_owned(),
        1 => "its one face is no triangle with three different corners".to_owned(),
        _ => format!("none of its {faces} faces is a triangle with three different corners"),
    };
    [told].iter().chain(left_out).map(String::as_str).collect::<Vec<_>>().join("; ")
}

impl BuildError {
    /// Whether there is too little memory for something, which is told without a name.
    pub fn is_about_memory(&self) -> bool {
        match self {
            BuildError::Extmem(chpm_extmem::ExtmemError::Budget { .. }) => true,
            BuildError::Kept { error, .. } | BuildError::WorkRemoved { error, .. } => error.is_about_memory(),
            _ => false,
        }
    }

    /// Whether someone asked to stop.
    pub fn is_cancelled(&self) -> bool {
        match self {
            BuildError::Cancelled => true,
            BuildError::Kept { error, .. } | BuildError::WorkRemoved { error, .. } => error.is_cancelled(),
            _ => false,
        }
    }
}

impl From<Cancelled> for BuildError {
    fn from(_: Cancelled) -> Self {
        BuildError::Cancelled
    }
}

impl From<SourceError> for BuildError {
    fn from(error: SourceError) -> Self {
        match error {
            SourceError::Cancelled => BuildError::Cancelled,
            SourceError::Extmem(error) => error.into(),
            error => BuildError::Source(Box::new(error)),
        }
    }
}

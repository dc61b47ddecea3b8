//! Images and materials of a source while they are found.

use super::{GREY, Image, Images, Textures};
use crate::error::{ImportError, SourceError};
use crate::location::excerpt;
use crate::reader::Beside;
use crate::stream::Tap;
use crate::supply::Supply;
use chpm_extmem::{Cancel, FailPoints, Reservation, Store};
use chpm_texture::{Alpha, Material, Wrap};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Bytes that a material or an image takes besides its name, at most.
const ENTRY: u64 = 512;
/// Losses that are told by name.
const TOLD: usize = 8;

/// Images and materials that were found so far, and what was not.
pub(crate) struct Table {
    asked: Images,
    materials: Vec<Material>,
    images: Vec<Image>,
    /// Images by their names, and by what their alpha means.
    known: BTreeMap<(PathBuf, Alpha), Option<u32>>,
    /// Other files and those of images, in the order in which they were named.
    files: Vec<PathBuf>,
    lost: u64,
    /// The colour of the first material that has no image by itself, and whether colours of such materials tell anything: they differ, or are more than a shade of grey.
    colors: (Option<[f32; 3]>, bool),
    told: Vec<String>,
    /// Reasons for faces without an image where there are images, in words, and how many more there are.
    lacks: (Vec<String>, u64),
    bytes: u64,
    /// Memory for all of it, where it is kept.
    share: Option<Reservation>,
}

impl Table {
    /// An empty one, whose memory is that of `store` if it is kept.
    pub(crate) fn new(asked: Images, store: Option<&Store>) -> Result<Table, ImportError> {
        let share = store.map(|store| store.budget.reserve_work("materials", 0)).transpose()?;
        Ok(Table {
            asked,
            materials: Vec::new(),
            images: Vec::new(),
            known: BTreeMap::new(),
            files: Vec::new(),
            lost: 0,
            colors: (None, false),
            told: Vec::new(),
            lacks: (Vec::new(), 0),
            bytes: 0,
            share,
        })
    }

    /// Whether triangles have images.
    fn has_images(&self) -> bool {
        !self.images.is_empty() || self.asked != Images::IfAny && self.lost > 0
    }

    /// Whether triangles have images, or colours of materials that tell anything.
    pub(crate) fn is_textured(&self) -> bool {
        self.has_images() || self.colors.1
    }

    /// Files that the source is made of besides itself, if it is textured.
    pub(crate) fn files(&self) -> &[PathBuf] {
        if self.is_textured() { &self.files } else { &[] }
    }

    /// Counts an entry with a name of so many bytes.
    pub(crate) fn count(&mut self, name: usize) -> Result<(), ImportError> {
        self.bytes += ENTRY + 2 * name as u64;
        Ok(self.share.as_mut().map_or(Ok(()), |share| share.resize(self.bytes))?)
    }

    /// Notes a file that names images.
    pub(crate) fn add_file(&mut self, path: PathBuf) {
        if !self.files.contains(&path) {
            self.files.push(path);
        }
    }

    /// Notes that something is not there.
    pub(crate) fn lose(&mut self, what: &str, name: &str, why: &str) -> Result<(), ImportError> {
        let told = format!("{what} '{}' {why}", excerpt(name.as_bytes()));
        if self.asked == Images::Required {
            return Err(ImportError::Unsupported(format!(
                "{told}: put it there, or have it grey with --missing-images grey"
            )));
        }
        self.lost += 1;
        if self.told.len() < TOLD {
            self.told.push(told);
        }
        Ok(())
    }

    /// Notes why faces have no image.
    pub(crate) fn lack(&mut self, told: String) -> Result<(), ImportError> {
        if self.asked == Images::Required {
            return Err(ImportError::Unsupported(format!(
                "{told}: mend the source, or leave them as they are with --missing-images grey"
            )));
        }
        if self.lacks.0.len() < TOLD {
            self.lacks.0.push(told)
        } else {
            self.lacks.1 += 1
        }
        Ok(())
    }

    /// The number of the image at a path that was found for `name`, or not; none if it cannot be read.
    pub(crate) fn file(
        &mut self,
        name: &str,
        found: Result<PathBuf, String>,
        alpha: Alpha,
    ) -> Result<Option<u32>, ImportError> {
        let key = match &found {
            Ok(path) => (path.clone(), alpha),
            Err(_) => (PathBuf::from(name), Alpha::default()),
        };
        if let Some(known) = self.known.get(&key) {
            return Ok(*known);
        }
        self.count(key.0.as_os_str().len())?;
        let image = match found {
            Ok(path) => self.image(name, Image::file(path, alpha))?,
            Err(why) => {
                self.lose("image", name, &why)?;
                None
            }
        };
        self.known.insert(key, image);
        Ok(image)
    }

    /// The number of an image; none if it is of no kind that is read.
    pub(crate) fn image(&mut self, name: &str, image: Image) -> Result<Option<u32>, ImportError> {
        let why = match image.is_of_known_kind() {
            Ok(true) => {
                image.path().map(Path::to_owned).into_iter().for_each(|path| self.add_file(path));
                self.images.push(image);
                return Ok(Some(self.images.len() as u32 - 1));
            }
            Ok(false) => "is neither PNG nor JPEG".to_owned(),
            Err(error) => format!("cannot be read: {error}"),
        };
        self.lose("image", name, &why)?;
        Ok(None)
    }

    /// The number of a material whose image is `image`, or one that is not there.
    pub(crate) fn material(
        &mut self,
        image: Option<u32>,
        factor: [f32; 4],
        wrap: [Wrap; 2],
    ) -> Result<u32, ImportError> {
        let [r, g, b, a] = factor;
        let factor = if image.is_some() { factor } else { [r * GREY, g * GREY, b * GREY, a] };
        self.add(Material { image, factor, wrap })
    }

    /// The number of a material that is nothing but a colour.
    pub(crate) fn color(&mut self, factor: [f32; 4]) -> Result<u32, ImportError> {
        let [r, g, b, _] = factor;
        let first = *self.colors.0.get_or_insert([r, g, b]);
        self.colors.1 |= r != g || g != b || first != [r, g, b];
        self.plain(factor)
    }

    /// The number of a material for those triangles of another that its image is not on.
    pub(crate) fn plain(&mut self, factor: [f32; 4]) -> Result<u32, ImportError> {
        self.add(Material { image: None, factor, wrap: [Wrap::Repeat; 2] })
    }

    fn add(&mut self, material: Material) -> Result<u32, ImportError> {
        self.count(0)?;
        self.materials.push(material);
        Ok(self.materials.len() as u32 - 1)
    }

    /// Losses, in words.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let becomes = if self.is_textured() { "grey instead" } else { "textures are left out" };
        let mut warnings: Vec<String> = self.told.iter().map(|told| format!("{told}: {becomes}")).collect();
        let more = self.lost - self.told.len() as u64;
        warnings.extend((more > 0).then(|| format!("{more} more images are not there: {becomes}")));
        let (told, more) = &self.lacks;
        warnings.extend(told.iter().cloned());
        warnings.extend((*more > 0).then(|| format!("{more} more materials were in no library")));
        warnings
    }

    /// Length and hash of the files besides the source.
    pub(crate) fn beside(&self, cancel: &Cancel) -> Result<Vec<Beside>, ImportError> {
        self.files().iter().map(|path| file_beside(path, cancel)).collect()
    }

    /// All that was found; none if there are neither images nor colours.
    pub(crate) fn finish(self, tints: bool) -> Option<Textures> {
        let (is_textured, are_plain) = (self.is_textured(), !self.has_images() && self.lost == 0);
        let Table { materials, images, .. } = self;
        is_textured.then_some(Textures { materials, images, tints, are_plain })
    }
}

/// Reads a whole file for its hash.
pub(crate) fn file_beside(path: &Path, cancel: &Cancel) -> Result<Beside, ImportError> {
    let supply = Supply::file(path)?;
    let read = Tap::open(&supply, &FailPoints::default(), cancel).and_then(Tap::finish);
    let (len, hash) = read.map_err(|source| SourceError::Read { path: path.to_owned(), source })?;
    Ok(Beside { path: path.to_owned(), first: None, len, hash })
}

//! Materials of a glTF as far as colour goes: factors, images, and how coordinates become places in these.

use super::text::Payload;
use super::views::{Region, Views, unescaped};
use crate::error::ImportError;
use crate::texture::{Image, Images, Table, beside};
use chpm_extmem::Store;
use chpm_texture::{Alpha, Wrap};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Materials, and what they are made of.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Looks {
    materials: Vec<Material>,
    textures: Vec<Texture>,
    images: Vec<ImageOf>,
    samplers: Vec<Sampler>,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Material {
    alpha_mode: Option<String>,
    alpha_cutoff: Option<f64>,
    pbr_metallic_roughness: Pbr,
    extensions: MaterialExtensions,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Pbr {
    base_color_factor: Option<[f64; 4]>,
    base_color_texture: Option<TextureInfo>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct MaterialExtensions {
    /// Colour in exports of photogrammetry before the other was usual.
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    glossiness: Option<Glossiness>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Glossiness {
    diffuse_factor: Option<[f64; 4]>,
    diffuse_texture: Option<TextureInfo>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct TextureInfo {
    index: u32,
    #[serde(default)]
    tex_coord: u32,
    #[serde(default)]
    extensions: InfoExtensions,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct InfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    transform: Option<Transform>,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Transform {
    offset: Option<[f64; 2]>,
    rotation: f64,
    scale: Option<[f64; 2]>,
    tex_coord: Option<u32>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Texture {
    sampler: Option<u32>,
    source: Option<u32>,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct ImageOf {
    uri: Option<String>,
    buffer_view: Option<u32>,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Sampler {
    wrap_s: Option<u32>,
    wrap_t: Option<u32>,
}

/// A material on triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coat {
    /// For vertices without coordinates.
    pub(super) plain: u32,
    pub(super) painted: Option<Painted>,
}

/// An image on triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Painted {
    pub(super) material: u32,
    /// Which coordinates of vertices it goes by.
    pub(super) set: u32,
    /// Factors of u and v, and an offset, for u and for v.
    transform: [[f64; 3]; 2],
}

impl Painted {
    /// A place in the image, of which glTF counts downwards.
    pub(super) fn place(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let [u, v] = self.transform.map(|[a, b, c]| a * f64::from(u) + b * f64::from(v) + c);
        [u as f32, (1.0 - v) as f32]
    }
}

/// Materials by their numbers, and the images of all of them.
pub(super) struct Coats {
    pub(super) table: Table,
    coats: Vec<Coat>,
}

/// Where images are.
pub(super) struct Places<'a, 'b> {
    pub(super) path: &'a Path,
    /// Whether nothing lies beside it.
    pub(super) is_pipe: bool,
    /// Bytes in the file itself; none if only names are asked for.
    pub(super) inner: Option<(&'a mut Views<'b>, &'a Region, &'a [Payload])>,
}

impl Coats {
    /// Finds the images of all materials; none where none are asked for, or there are none.
    pub(super) fn find(
        json: &[u8],
        images: Images,
        places: Places<'_, '_>,
        store: Option<&Store>,
    ) -> Result<Option<Coats>, ImportError> {
        let names = |key: &[u8]| json.windows(key.len()).any(|bytes| bytes == key);
        let has_images = names(b"\"images\"");
        if images == Images::Ignored || !has_images && !names(b"\"materials\"") {
            return Ok(None);
        }
        let mut table = Table::new(images, store)?;
        let looks: Looks = match serde_json::from_slice(json) {
            Ok(looks) => looks,
            Err(_) if !has_images => return Ok(None),
            Err(error) => {
                table.lose("material", "", &format!("cannot be read: {error}"))?;
                return Ok(Some(Coats { table, coats: Vec::new() }));
            }
        };

        let mut finder = Finder { looks: &looks, found: BTreeMap::new(), table, places };
        let coats = looks.materials.iter().map(|material| finder.coat(material)).collect::<Result<_, _>>()?;
        Ok(Some(Coats { table: finder.table, coats }))
    }

    /// The material of a primitive, if it has one that is there.
    pub(super) fn get(&self, number: Option<u32>) -> Option<Coat> {
        self.coats.get(number? as usize).copied()
    }
}

struct Finder<'a, 'b, 'c> {
    looks: &'a Looks,
    /// Images by their numbers, and by what their alpha means.
    found: BTreeMap<(u32, Alpha), Option<u32>>,
    table: Table,
    places: Places<'b, 'c>,
}

impl Finder<'_, '_, '_> {
    fn coat(&mut self, material: &Material) -> Result<Coat, ImportError> {
        let Pbr { base_color_factor: mut factor, base_color_texture: ref info } =
            material.pbr_metallic_roughness;
        let mut info = info.as_ref();
        if let (None, Some(glossiness)) = (info, &material.extensions.glossiness) {
            (factor, info) = (glossiness.diffuse_factor, glossiness.diffuse_texture.as_ref());
        }

        let (factor, alpha) = material.shown(factor.unwrap_or([1.0; 4]));
        let factor = encoded(factor);
        let plain = match info {
            Some(_) => self.table.plain(factor)?,
            None => self.table.color(factor)?,
        };
        let painted = info.map(|info| self.painted(info, factor, alpha)).transpose()?;
        Ok(Coat { plain, painted })
    }

    fn painted(
        &mut self,
        info: &TextureInfo,
        factor: [f32; 4],
        alpha: Alpha,
    ) -> Result<Painted, ImportError> {
        let texture = self.looks.textures.get(info.index as usize);
        let image = texture.and_then(|texture| texture.source);
        let image = match image {
            Some(number) => self.image(number, alpha)?,
            None => {
                self.table.lose("texture", &info.index.to_string(), "is of no kind that is read")?;
                None
            }
        };

        let sampler = texture.and_then(|texture| self.looks.samplers.get(texture.sampler? as usize));
        let wrap = sampler.map_or([None; 2], |sampler| [sampler.wrap_s, sampler.wrap_t]).map(wrap);
        let material = self.table.material(image, factor, wrap)?;
        let Some(moved) = &info.extensions.transform else {
            let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            return Ok(Painted { material, set: info.tex_coord, transform });
        };
        let set = moved.tex_coord.unwrap_or(info.tex_coord);
        Ok(Painted { material, set, transform: moved.rows() })
    }

    fn image(&mut self, number: u32, alpha: Alpha) -> Result<Option<u32>, ImportError> {
        if let Some(found) = self.found.get(&(number, alpha)) {
            return Ok(*found);
        }
        let name = format!("number {number}");
        let found = match self.looks.images.get(number as usize) {
            Some(ImageOf { uri: Some(uri), .. }) if !uri.starts_with("data:") => self.outside(uri, alpha)?,
            Some(image) => match self.inside(image, &name, alpha) {
                None => None,
                Some(Ok(image)) => self.table.image(&name, image)?,
                Some(Err(why)) => {
                    self.table.lose("image", &name, &why)?;
                    None
                }
            },
            None => {
                self.table.lose("image", &name, "is not there")?;
                None
            }
        };
        self.found.insert((number, alpha), found);
        Ok(found)
    }

    fn outside(&mut self, uri: &str, alpha: Alpha) -> Result<Option<u32>, ImportError> {
        let name = unescaped(uri).unwrap_or_else(|| uri.to_owned());
        let found = match self.places.is_pipe {
            true => Err("lies beside a file, and this is a pipe".to_owned()),
            false => beside::find(&name, self.places.path),
        };
        self.table.file(&name, found, alpha)
    }

    /// An image in the file itself, or why it cannot be had; none if that is not asked for.
    fn inside(&mut self, image: &ImageOf, name: &str, alpha: Alpha) -> Option<Result<Image, String>> {
        let (views, data, payloads) = self.places.inner.as_mut()?;
        let region = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                let number = uri.strip_prefix("data:").and_then(|number| number.parse::<usize>().ok());
                let payload =
                    number.and_then(|number| payloads.get(number)).filter(|payload| payload.is_valid);
                let Some(payload) = payload else { return Some(Err("is no valid base64".to_owned())) };
                data.part(payload.start, payload.len, "a data URI")
            }
            (None, Some(view)) => views.view(view).map(|(region, _)| region),
            (None, None) => return Some(Err("is nowhere".to_owned())),
        };
        let image = region.map(|region| region.image(name.to_owned(), alpha));
        Some(image.map_err(|error| format!("cannot be read: {error}")))
    }
}

impl Material {
    /// The factor of colours, and what alpha means.
    fn shown(&self, [r, g, b, a]: [f64; 4]) -> ([f64; 4], Alpha) {
        match self.alpha_mode.as_deref() {
            Some("BLEND") => ([r, g, b, a], Alpha::Kept),
            Some("MASK") => {
                // What counts is the product with the factor.
                let least = self.alpha_cutoff.unwrap_or(0.5) / a * 255.0;
                ([r, g, b, 1.0], Alpha::Cut(least.ceil().clamp(0.0, 255.0) as u8))
            }
            _ => ([r, g, b, 1.0], Alpha::Ignored),
        }
    }
}

impl Transform {
    /// Scaled, then turned, then moved.
    fn rows(&self) -> [[f64; 3]; 2] {
        let ([x, y], [sx, sy]) = (self.offset.unwrap_or([0.0; 2]), self.scale.unwrap_or([1.0; 2]));
        let (sin, cos) = (libm::sin(self.rotation), libm::cos(self.rotation));
        [[cos * sx, sin * sy, x], [-sin * sx, cos * sy, y]]
    }
}

fn wrap(code: Option<u32>) -> Wrap {
    match code {
        Some(33071) => Wrap::Clamp,
        Some(33648) => Wrap::Mirror,
        _ => Wrap::Repeat,
    }
}

/// A factor of light, as one of sRGB.
fn encoded([r, g, b, a]: [f64; 4]) -> [f32; 4] {
    let [r, g, b] = [r, g, b].map(super::walk::encoded);
    [r, g, b, a].map(|x| x.clamp(0.0, 1.0) as f32)
}

/// The files that images of the glTF at `path` lie in, if it is textured.
pub(super) fn files(json: &[u8], path: &Path, images: Images) -> Result<Vec<PathBuf>, ImportError> {
    let coats = Coats::find(json, images, Places { path, is_pipe: false, inner: None }, None)?;
    Ok(coats.map_or_else(Vec::new, |coats| coats.table.files().to_vec()))
}

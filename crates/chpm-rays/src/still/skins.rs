//! Looks of clusters' meshes, as many of them as there is room for.

use super::Paint;
use super::borders::Borders;
use super::sheet;
use super::skin::Skin;
use crate::error::RayError;
use crate::readers::Readers;
use chpm_format::{Chpm, ImageCodec, SheetRecord};
use chpm_mesh::ClusterId;

/// Skins by cluster.
pub(super) struct Skins<'s, 'a, D> {
    file: &'a Chpm<D>,
    paint: &'s Paint,
    borders: Option<Borders>,
    all: Vec<Option<Skin>>,
    used: u64,
    room: u64,
    readers: Readers,
}

impl<'s, 'a, D: AsRef<[u8]> + Sync> Skins<'s, 'a, D> {
    /// None yet.
    pub(super) fn new(
        file: &'a Chpm<D>,
        paint: &'s Paint,
        is_smooth: bool,
        room: u64,
        readers: Readers,
    ) -> Self {
        Skins {
            file,
            paint,
            borders: is_smooth.then(|| Borders::new(file, readers)),
            all: std::iter::repeat_with(|| None).take(file.clusters().len()).collect(),
            used: 0,
            room,
            readers,
        }
    }

    /// The skin of a cluster, if it is there.
    pub(super) fn get(&self, cluster: ClusterId) -> Option<&Skin> {
        self.all[cluster.index()].as_ref()
    }

    /// How many of these clusters, at least one if there is any, have room together.
    pub(super) fn fitting(&self, clusters: &[ClusterId]) -> usize {
        let (mut count, mut due) = (0, 0);
        while count < clusters.len() && (count == 0 || due < self.room) {
            due += self.bytes_of(clusters[count]);
            count += 1;
        }
        count
    }

    /// Whether anything is seen through the images that clusters have.
    pub(super) fn have_holes(&self) -> bool {
        let is_open = |sheet: &SheetRecord| sheet.codec() == Some(ImageCodec::Png);
        self.sheets().iter().any(is_open)
    }

    /// Images that are shown, by cluster; none where colours are others.
    fn sheets(&self) -> &'a [SheetRecord] {
        if *self.paint == Paint::Own { self.file.sheets() } else { &[] }
    }

    fn bytes_of(&self, cluster: ClusterId) -> u64 {
        let record = &self.file.clusters()[cluster.index()];
        let image = self.sheets().get(cluster.index());
        let image = image.map_or(0, |image| sheet::bytes_of(image, record.triangle_count));
        Skin::bytes_of(record) + image
    }

    /// Reads what meshes of clusters look like, in place of all others where there is no room.
    pub(super) fn put_on(
        &mut self,
        finest: &[bool],
        clusters: &[ClusterId],
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<(), RayError> {
        let new = |all: &[Option<Skin>]| -> Vec<ClusterId> {
            clusters.iter().copied().filter(|cluster| all[cluster.index()].is_none()).collect()
        };
        let mut missing = new(&self.all);
        let bytes =
            |missing: &[ClusterId]| missing.iter().map(|cluster| self.bytes_of(*cluster)).sum::<u64>();
        let mut due = bytes(&missing);
        if self.used + due > self.room {
            due = bytes(clusters);
            self.all.iter_mut().for_each(|skin| *skin = None);
            self.used = 0;
            missing = clusters.to_vec();
        }
        self.used += due;
        let file = self.file;
        let is_finest = |cluster: ClusterId| finest[cluster.index()];
        if let Some(borders) = self.borders.as_mut().filter(|_| !file.header().attributes().has_normals()) {
            borders.learn(file, &missing, is_finest, go_on)?;
        }
        let (borders, paint, has_images) = (self.borders.as_ref(), self.paint, !self.sheets().is_empty());
        let read = |cluster: &ClusterId| {
            if !go_on() {
                return Err(RayError::Stopped);
            }
            let mut skin = Skin::new(&file.page(*cluster)?.view(), is_finest(*cluster), paint, borders);
            if has_images && let Some(image) = file.sheet(*cluster)? {
                skin.sheet = Some(sheet::painted(image).ok_or(RayError::Image(*cluster))?);
            }
            Ok(skin)
        };
        let made = self.readers.read(&missing, read)?;
        for (cluster, skin) in missing.into_iter().zip(made) {
            self.all[cluster.index()] = Some(skin);
        }
        Ok(())
    }
}

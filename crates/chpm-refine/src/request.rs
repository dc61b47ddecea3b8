//! A mesh as it is asked for, and what a file has less of: for `chpm extract` and for programs, which so have the same meshes.

use crate::cut::Cut;
use crate::error::RefineError;
use crate::hierarchy::Hierarchy;
use crate::select::{is_visible, select_while};
use crate::view::View;
use crate::{budget, extract::Extraction};
use chpm_format::Chpm;
use chpm_mesh::{Counted, Length, Level, Thousands, Triangles, Units, geom};
use std::fmt::Display;

/// Which mesh of a file; one of these.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Request {
    /// The coarsest that is nowhere farther from the source, nor the source from it; nothing is exempt.
    Within(Length),
    /// The finest of at most so many triangles: of the least error everywhere, or in a view, whose own pixels of error do not count.
    Triangles(Triangles, Option<View>),
    /// All clusters of a level at their finest; 0 is the source.
    Level(u32),
    /// The coarsest whose error covers at most the pixels of a view, wherever it is seen.
    View(View),
}

/// Requested quality that a file does not have.
#[derive(Clone, Copy, PartialEq, Debug)]
#[non_exhaustive]
pub enum Shortfall {
    /// The finest mesh is farther.
    Error {
        /// How far what was asked for may be.
        asked: Length,
        /// How far the finest mesh is, object units.
        least: f32,
    },
    /// Dropped components may be farther: the file is of version 1.0.
    Unknown,
    /// The finest mesh has fewer triangles.
    Triangles {
        /// How many there may be.
        asked: u64,
        /// How many there are.
        most: u64,
    },
    /// Nothing is in the image.
    Unseen,
}

impl Request {
    /// Selects. A mesh that will be rounded on its way, by so many object units at most, keeps to a distance with that. What is known of clusters
    /// is kept in at most so many bytes; before a page is read, `go_on` is asked whether to.
    ///
    /// # Errors
    /// [`RefineError::Level`] for a level that the file lacks; [`RefineError::Format`] for a damaged page. Whether there are few enough
    /// triangles, [`Request::check`] tells. And what `go_on` answers.
    pub fn cut<D: AsRef<[u8]>, E: From<RefineError>>(
        &self,
        file: &Chpm<D>,
        rounding: f64,
        bytes: u64,
        go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Cut, E> {
        let model = file.header().source_triangle_count;

        match *self {
            Request::Within(bound) => Cut::at_distance_while(file, left(file, bound, rounding), go_on),
            Request::Triangles(wanted, None) => budget::best_anywhere(file, wanted.of(model), bytes, go_on),
            Request::Triangles(wanted, Some(view)) => {
                let (hierarchy, limit) = (Hierarchy::new(file), wanted.of(model));
                budget::best_in_view(file, &hierarchy, &view, limit, bytes, go_on)
            }
            Request::Level(level) => {
                let highest = file.header().level_count - 1;
                if level > highest {
                    return Err(RefineError::Level { got: level, highest }.into());
                }
                Ok(Cut::at_level(file, Level(level)))
            }
            Request::View(view) => select_while(file, &Hierarchy::new(file), &view, go_on),
        }
    }

    /// How far a mesh may be from the source that will be rounded on its way, object units; none if no distance is asked for.
    pub fn distance<D: AsRef<[u8]>>(&self, file: &Chpm<D>, rounding: f64) -> Option<f32> {
        let Request::Within(bound) = *self else { return None };
        Some(left(file, bound, rounding))
    }

    /// Refuses a mesh of more triangles than were asked for: the coarsest has more.
    ///
    /// # Errors
    /// [`RefineError::Coarsest`].
    pub fn check<D: AsRef<[u8]>>(&self, file: &Chpm<D>, mesh: &Extraction<'_, D>) -> Result<(), RefineError> {
        let Request::Triangles(wanted, _) = self else { return Ok(()) };
        let (least, limit) = (mesh.triangle_count(), wanted.of(file.header().source_triangle_count));
        if least <= limit { Ok(()) } else { Err(RefineError::Coarsest { least }) }
    }

    /// Missing quality, where the cut that it gave keeps to such a distance, object units.
    pub fn shortfall<D: AsRef<[u8]>>(&self, file: &Chpm<D>, cut: &Cut, distance: f32) -> Option<Shortfall> {
        let header = file.header();
        match *self {
            Request::Within(asked) if f64::from(distance) > asked.of(header.aabb().diagonal()) => {
                Some(Shortfall::Error { asked, least: distance })
            }
            Request::Within(_) => (!file.has_gaps()).then_some(Shortfall::Unknown),
            Request::Triangles(Triangles::Count(asked), _) => {
                let most = header.source_triangle_count;
                (asked > most).then_some(Shortfall::Triangles { asked, most })
            }
            Request::View(view) if view.is_culling() => {
                let mut records = cut.members().iter().map(|member| &file.clusters()[member.cluster.index()]);
                let seen = records.any(|record| is_visible(record, &view));
                (!seen).then_some(Shortfall::Unseen)
            }
            _ => None,
        }
    }
}

impl Shortfall {
    /// In a sentence about a file of this name and a model of this diagonal.
    pub fn describe(&self, name: impl Display, diagonal: f64) -> String {
        match *self {
            Shortfall::Error { asked, least } => {
                let (least, asked) = (Units(least.into()), asked.describe(diagonal));
                format!("the finest mesh of '{name}' has an error of {least}, more than {asked}")
            }
            Shortfall::Unknown => format!(
                "'{name}' is of version 1.0, which does not tell how far what has vanished is: components that are missing may be \
                 farther than was asked; build it again"
            ),
            Shortfall::Triangles { asked, most } => {
                let (most, asked) = (Counted(most, "triangle"), Thousands(asked));
                format!("the finest mesh of '{name}' has {most}, fewer than {asked}")
            }
            Shortfall::Unseen => {
                format!("nothing of '{name}' is in the image: all of it is as coarse as it gets")
            }
        }
    }
}

/// Bound that is left for a mesh that is rounded: with that, and rounded up, it is never more than was asked for.
fn left<D: AsRef<[u8]>>(file: &Chpm<D>, bound: Length, rounding: f64) -> f32 {
    let bound = geom::round_down(bound.of(file.header().aabb().diagonal()));
    match rounding > 0.0 {
        true => ((geom::before_round_up(bound) - rounding) as f32).next_down().max(0.0),
        false => bound,
    }
}

//! How fine the next frame is: as fine as was asked for at rest, and while the picture moves as fine as a frame can be in time.
//! Triangles and times of frames in, pixels of error out; no clock.

/// Wanted quality and speed of the pictures.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Wish {
    /// Pixels of error that are allowed; no picture is finer.
    pub poe: f64,
    /// The most triangles of a picture.
    pub triangles: u64,
    /// Milliseconds of a frame while something moves; at rest a frame may take what it takes.
    pub ms: f64,
}

/// A frame that was drawn.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Took {
    /// The pixels of error that it was asked for.
    pub poe: f64,
    /// Triangles in it.
    pub triangles: u64,
    /// Time of the frame, if it is known.
    pub ms: Option<f64>,
}

/// Triangles that a picture may have however long they take: with fewer it shows another model.
const FEWEST: f64 = 20_000.0;
/// No number of triangles asks for more.
const MOST: f64 = 1e4;
/// Pixels of error below which nobody sees a difference.
const FINEST: f64 = 1.0 / 64.0;
/// Pixels of error of the first frame, if it moves.
const FIRST: f64 = 16.0;
/// A frame in motion may take so many times as long as it should.
const SLOW: f64 = 1.15;
/// How much coarser than one that took too long the next attempts are, and what remains of that from frame to frame.
const MARGIN: f64 = 1.25;
const FORGET: f64 = 0.995;
/// Weight of the last frame in the smoothed cost.
const SMOOTH: f64 = 0.3;

/// Goes from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Detail {
    /// The bound of the next frame; none before the first.
    poe: Option<f64>,
    /// The bound that the last motion came to.
    moving: Option<f64>,
    was_moving: bool,
    /// With fewer pixels of error than these a frame in motion took too long; forgotten by and by.
    too_fine: f64,
    costs: Costs,
}

impl Detail {
    /// The pixels of error for the next frame, after the one that was drawn last.
    pub fn next(&mut self, wish: &Wish, took: Option<&Took>, moves: bool) -> f64 {
        let least = wish.poe.max(FINEST);
        let next = match took {
            None => self.poe.unwrap_or(least),
            Some(took) => {
                if let Some(ms) = took.ms {
                    self.costs.take(took.triangles, ms);
                }
                self.after(wish, took, moves)
            }
        };
        // What the last motion came to is a good guess for this one; before any, a picture that is soon finer is better than one that hangs.
        let begins = moves && !self.was_moving;
        let guess =
            if begins { self.moving.unwrap_or(if took.is_none() { FIRST } else { 0.0 }) } else { 0.0 };
        let next = next.max(guess).clamp(least, least.max(MOST));
        if moves {
            self.moving = Some(next);
        }
        (self.poe, self.was_moving) = (Some(next), moves);
        next
    }

    fn after(&mut self, wish: &Wish, took: &Took, moves: bool) -> f64 {
        let triangles = took.triangles.max(1) as f64;
        let by_count = toward(triangles / wish.triangles.max(1) as f64, 1.0, took.poe);
        if !moves {
            return by_count;
        }

        // Where triangles come in large steps, it is not tried again and again whether one step more is too much.
        let share = triangles / self.costs.affordable(wish.ms);
        self.too_fine =
            if share > SLOW { self.too_fine.max(MARGIN * took.poe) } else { FORGET * self.too_fine };
        let by_time = toward(share, SLOW, took.poe);
        by_count.max(if by_time < took.poe { by_time.max(self.too_fine).min(took.poe) } else { by_time })
    }

    /// A frame found its picture as it was, and took so many milliseconds all the same.
    pub fn take_empty(&mut self, ms: f64) {
        self.costs.take_empty(ms);
    }
}

/// Next screen-space error towards a number of triangles; one that is nearly right stays. Triangles fall with the square of the error at most: a picture that is too coarse is approached, not passed.
fn toward(share: f64, coarse: f64, took_poe: f64) -> f64 {
    match share {
        share if (0.85..=coarse).contains(&share) => took_poe,
        share => took_poe * (share / 0.95).sqrt().clamp(0.5, 2.0),
    }
}

/// Cost of frames in milliseconds, smoothed: a fixed part, as frames tell that draw nothing new, and a part for each triangle.
#[derive(Clone, Debug, Default)]
struct Costs {
    fixed: f64,
    each: Option<f64>,
}

impl Costs {
    fn take(&mut self, triangles: u64, ms: f64) {
        let each = (ms - self.fixed).max(0.0) / triangles.max(1) as f64;
        let before = self.each.unwrap_or(each);
        self.each = Some(before + SMOOTH * (each - before));
    }

    fn take_empty(&mut self, ms: f64) {
        self.fixed += SMOOTH * (ms - self.fixed);
    }

    /// How many triangles a frame of so many milliseconds may have.
    fn affordable(&self, ms: f64) -> f64 {
        // Half of the time is theirs in any case: coarser ones help little where the rest takes long.
        let theirs = (ms - self.fixed).max(0.5 * ms);
        self.each.map_or(f64::INFINITY, |each| (theirs / each).max(FEWEST))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WISH: Wish = Wish { poe: 1.0, triangles: 1_000_000, ms: 30.0 };

    /// A model whose triangles fall with the square of the error, on a machine of these costs in milliseconds.
    struct Machine {
        all: f64,
        fixed: f64,
        each: f64,
    }

    impl Machine {
        fn draw(&self, poe: f64) -> Took {
            let triangles = (self.all / (poe * poe)) as u64 + 100;
            Took { poe, triangles, ms: Some(self.fixed + self.each * triangles as f64) }
        }

        /// The frames of some motion, or of a rest.
        fn frames(
            &self,
            detail: &mut Detail,
            last: &mut Option<Took>,
            wish: &Wish,
            moves: bool,
            count: usize,
        ) -> Vec<Took> {
            (0..count)
                .map(|_| {
                    let took = self.draw(detail.next(wish, last.as_ref(), moves));
                    *last = Some(took);
                    took
                })
                .collect()
        }
    }

    #[test]
    fn motion_comes_to_its_time_and_rest_to_what_was_asked_for() {
        let (mut detail, mut last) = (Detail::default(), None);
        let slow = Machine { all: 9e5, fixed: 8.0, each: 3e-4 };
        let rest = slow.frames(&mut detail, &mut last, &WISH, false, 3);
        (0..20).for_each(|_| detail.take_empty(8.0));
        assert!(rest.iter().all(|took| took.poe == 1.0), "{rest:?}");
        let motion = slow.frames(&mut detail, &mut last, &WISH, true, 40);
        let late = motion.iter().skip(12).map(|took| took.ms.unwrap_or(0.0));
        assert!(late.clone().fold(0.0, f64::max) <= 36.0, "{motion:?}");
        assert!(late.fold(f64::MAX, f64::min) >= 20.0, "no coarser than it has to be: {motion:?}");
        // At rest the bound falls at once, and its frames together take not much longer than the last of them.
        let rest = slow.frames(&mut detail, &mut last, &WISH, false, 8);
        let (first, end) = (rest[0], rest[7]);
        assert!(first.poe < 0.6 * motion[39].poe && end.poe == 1.0, "{rest:?}");
        let until = rest.iter().position(|took| took.poe == 1.0).unwrap();
        let all: f64 = rest[..until].iter().map(|took| took.ms.unwrap_or(0.0)).sum();
        assert!(all < end.ms.unwrap_or(0.0), "{rest:?}");
        // The next motion begins where this one came to.
        let again = slow.frames(&mut detail, &mut last, &WISH, true, 1);
        assert!(again[0].ms.unwrap_or(0.0) < 40.0, "{again:?}");
    }

    #[test]
    fn a_fast_machine_draws_what_was_asked_for_while_it_moves() {
        let (mut detail, mut last) = (Detail::default(), None);
        let fast = Machine { all: 3e5, fixed: 2.0, each: 1e-5 };
        let frames = fast.frames(&mut detail, &mut last, &WISH, true, 30);
        assert!(frames.iter().skip(12).all(|took| took.poe == 1.0), "{frames:?}");
    }

    #[test]
    fn what_takes_long_without_triangles_does_not_cost_them() {
        let (mut detail, mut last) = (Detail::default(), None);
        // At rest it has shown that nothing helps here: a frame without any triangle takes twice as long as it should.
        let filled = Machine { all: 2e5, fixed: 60.0, each: 5e-5 };
        filled.frames(&mut detail, &mut last, &WISH, false, 3);
        (0..20).for_each(|_| detail.take_empty(60.0));
        let frames = filled.frames(&mut detail, &mut last, &WISH, true, 30);
        assert!(frames.iter().skip(10).all(|took| took.poe <= 1.3), "{frames:?}");
        // And whatever happens, the model can be told.
        let slow = Machine { all: 2e6, fixed: 900.0, each: 1e-2 };
        let frames = slow.frames(&mut detail, &mut last, &WISH, true, 60);
        assert!(frames.iter().all(|took| took.triangles > 12_000), "{frames:?}");
    }

    #[test]
    fn detail_does_not_flicker_where_triangles_come_in_large_steps() {
        let (mut detail, mut last) = (Detail::default(), None);
        // Below 20 pixels of error there are three times as many triangles, which take too long.
        let draw = |poe: f64| {
            let triangles = if poe < 20.0 { 120_000 } else { 40_000 };
            Took { poe, triangles, ms: Some(4e-4 * triangles as f64) }
        };
        let mut changes = 0;
        for frame in 0..200 {
            let took = draw(detail.next(&WISH, last.as_ref(), true));
            changes += usize::from(frame > 50 && last.is_some_and(|last| last.triangles != took.triangles));
            last = Some(took);
        }
        assert!(changes <= 12, "{changes} changes in 150 frames");
    }

    #[test]
    fn no_more_triangles_than_are_wanted() {
        let (mut detail, mut last) = (Detail::default(), None);
        let wish = Wish { triangles: 50_000, ..WISH };
        let fast = Machine { all: 3e6, fixed: 1.0, each: 1e-6 };
        for moves in [false, true, false] {
            let frames = fast.frames(&mut detail, &mut last, &wish, moves, 40);
            let end = frames[39];
            assert!((40_000..=50_000).contains(&end.triangles), "{moves}: {frames:?}");
            assert_eq!(frames[38].poe, end.poe, "it comes to rest");
        }
        // A budget that decides alone asks for no error.
        let wish = Wish { poe: 0.0, ..wish };
        assert!(
            (40_000..=50_000).contains(&fast.frames(&mut detail, &mut last, &wish, false, 40)[39].triangles)
        );
    }

    #[test]
    fn a_frame_that_was_not_drawn_changes_nothing() {
        let mut detail = Detail::default();
        let first = detail.next(&WISH, Some(&Took { poe: 4.0, triangles: 900_000, ms: Some(100.0) }), false);
        assert_eq!(first, detail.next(&WISH, None, false));
    }

    proptest! {
        /// Whatever times come in, the bound is one that can be drawn with.
        #[test]
        fn the_bound_stays_within_reason(
            frames in prop::collection::vec((0u64..10_000_000, 0.0..5e3f64, any::<bool>()), 1..60),
            poe in 0.0..40.0f64,
        ) {
            let (wish, mut detail, mut last) = (Wish { poe, ..WISH }, Detail::default(), None);
            for (triangles, ms, moves) in frames {
                let poe = detail.next(&wish, last.as_ref(), moves);
                prop_assert!(poe >= wish.poe.max(FINEST) && poe <= MOST, "{}", poe);
                last = Some(Took { poe, triangles, ms: Some(ms) });
            }
        }
    }
}

//! Budgets of time.

use crate::common::*;
use dapple_core::{Control, Error, Film, Filter, Filtered, Limits, Needs, Render, Status};

/// A filter that sleeps for a microsecond per pixel, and would so many times from 4 samples per pixel on.
struct Sleeper(u32);

impl Filter for Sleeper {
    fn name(&self) -> &str {
        "sleeper"
    }

    fn runs(&self, _: &Needs, spp: f64) -> u32 {
        if spp < 4.0 { 1 } else { self.0 }
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        std::thread::sleep(std::time::Duration::from_micros(film.frame().pixels() as u64));
        Ok(Filtered::new(film.frame().size(), film.image()))
    }
}

#[test]
fn a_time_limit_leaves_room_for_the_filter() {
    // The filter is timed after the first pass, which must end in time on a busy machine too.
    let (frame, limits) = (frame(512, 512), Limits::seconds(2.5));
    let reserved = std::cell::Cell::new(None);
    let traced = |filter: Option<&Sleeper>| {
        let mut sampler = uniform(5);
        let mut monitor = |status: &Status<'_>| {
            reserved.set(status.filter_seconds);
            Control::Continue
        };
        let render = Render::new(frame, &limits).monitor(&mut monitor);
        let render = match filter {
            Some(filter) => render.error_of(filter),
            None => render,
        };
        let film = render.run(&mut Field(noise), &mut sampler).unwrap();
        film.record().trace_seconds()
    };
    let with = traced(Some(&Sleeper(1)));
    let seconds = reserved.get().expect("the filter was timed");
    // It sleeps for 0.262 s at least; a busy machine wakes it late.
    assert!((0.262..5.0).contains(&seconds), "{seconds}");
    traced(Some(&Sleeper(3)));
    let seconds = reserved.get().expect("the filter was timed");
    assert!((0.786..15.0).contains(&seconds), "{seconds} for three runs");
    let without = traced(None);
    assert_eq!(reserved.get(), Some(0.0));
    assert!(with < without, "{with} {without}");
}

/// A limit beyond any number of samples ends at the largest count, here 3.
#[test]
fn endless_time_limits_do_not_overflow() {
    for seconds in [1e30, f64::MAX] {
        let limits = Limits::seconds(seconds).with_max_spp(3);
        let mut sampler = uniform(5);
        let film = run(&mut Field(noise), &mut sampler, Needs::none(), frame(5, 4), &limits).unwrap();
        assert_eq!(film.record().samples, 60);
    }
}

//! The monitor of a render: progress, images and states while it runs.

use crate::{Film, snapshot::View};

/// The state of a render, passed to a [`Monitor`] about every 0.2 seconds during tracing.
#[non_exhaustive]
#[derive(Clone, Copy)]
pub struct Status<'a> {
    /// The film so far, with valid statistics in every pixel.
    pub film: &'a Film,
    /// The number of the round being traced, from 0.
    pub round: u32,
    /// The number of samples traced so far.
    pub samples: u64,
    /// The total number of samples to trace, as far as known; a time or error limit may change it.
    pub expected: u64,
    /// Wall-clock seconds spent on planning and tracing so far, without the monitor's own time.
    pub seconds: f64,
    /// The time limit in seconds, if there is one.
    pub seconds_limit: Option<f64>,
    /// The part of the time limit reserved for the filter, in seconds; `None` until measured, after the first round.
    pub filter_seconds: Option<f64>,
    pub(super) view: View<'a>,
}

impl Status<'_> {
    /// The state of the render as bytes for [`Snapshot::from_bytes`](crate::Snapshot::from_bytes), about as large as the
    /// film in memory.
    pub fn snapshot(&self) -> Vec<u8> {
        self.view.write()
    }
}

/// A monitor's decision about the render.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Continue rendering.
    Continue,
    /// Stop the render and return the film so far.
    Stop,
}

/// An observer of a render, called about five times a second: for progress, previews, checkpoints and Ctrl-C.
///
/// A closure `FnMut(&Status) -> Control` is a monitor too. The closure below keeps an image and the bytes of a checkpoint
/// at every doubling of the samples:
///
/// ```
/// use dapple_core::{Filter, Unfiltered};
/// use dapple_core::render::{Control, Status};
/// # use dapple_core::{Block, Draws, Estimate, Frame, Integrator, Limits, PointSet, Render, SampleId, Worker, samplers::Uniform};
/// # struct Grey;
/// # impl PointSet for Grey {
/// #     fn describe(&self) -> String { "grey".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// # impl Integrator for Grey {
/// #     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate { Estimate::new([draws.block(Block::new(0))[0]; 3]) }
/// # }
///
/// let (mut next, mut kept) = (0, Vec::new());
/// let mut keep = |status: &Status<'_>| {
///     if status.samples >= next {
///         kept.push((Unfiltered.apply(status.film), status.snapshot()));
///         next = 2 * status.samples;
///     }
///     Control::Continue
/// };
/// # let limits = Limits::samples(64 * 64 * 32);
/// # Render::new(Frame::new(64, 64)?, &limits).monitor(&mut keep).run(&mut Grey, &mut Uniform::new(Grey))?;
/// # assert!(kept.len() > 1 && kept.iter().all(|(image, state)| image.is_ok() && !state.is_empty()));
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// ```
/// use dapple_core::render::{Control, Monitor, Status};
///
/// /// Stops after a minute.
/// struct Minute;
///
/// impl Monitor for Minute {
///     fn slice(&mut self, status: &Status<'_>) -> Control {
///         if status.seconds < 60.0 { Control::Continue } else { Control::Stop }
///     }
/// }
/// ```
pub trait Monitor {
    /// Called about every 0.2 seconds during tracing. The returned value decides whether the render continues.
    fn slice(&mut self, status: &Status<'_>) -> Control;

    /// Called once at the end, unless the render was stopped. A render resumed from a snapshot taken here may have
    /// larger limits.
    fn end(&mut self, status: &Status<'_>) {
        let _ = status;
    }
}

/// The monitor that does nothing: the render runs to the end.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoMonitor;

impl Monitor for NoMonitor {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }
}

impl<F: FnMut(&Status<'_>) -> Control> Monitor for F {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self(status)
    }
}

//! Training passes without the rest of a render.

use super::{Monitor, NoMonitor, Render, Status, round};
use crate::{
    Control, Draws, Error, Estimate, Integrator, Needs, Pass, Prepared, Prepares, Sampler, TrainingData, Worker,
};
use std::sync::atomic::{AtomicBool, Ordering};

impl Render<'_> {
    /// Traces until the integrator has learned enough, and returns the data of its training passes; `None` if the monitor
    /// stopped it before.
    ///
    /// The film records nothing but means: in halves, if the render's does.
    ///
    /// # Errors
    ///
    /// The errors of [`Render::run`].
    pub fn train(
        mut self,
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Option<Vec<TrainingData>>, Error> {
        if !integrator.wants_training() {
            return Ok(Some(Vec::new()));
        }
        let halves = self.needs.and(integrator.needs()).and(sampler.needs()).halves;
        self.needs = Needs { halves, ..Needs::none() };
        let mut unwatched = NoMonitor;
        let monitor: &mut dyn Monitor = match self.monitor.take() {
            Some(monitor) => monitor,
            None => &mut unwatched,
        };
        let mut session = self.session(sampler, None)?;
        let learned = AtomicBool::new(false);
        let mut trainee = Trainee { integrator, learned: &learned };
        let mut stopped = false;
        let mut watch = |status: &Status<'_>| {
            if learned.load(Ordering::Relaxed) {
                return Control::Stop;
            }
            let control = monitor.slice(status);
            stopped |= control == Control::Stop;
            control
        };
        while session.open(None)? {
            let end = round::trace(&mut trainee, &mut session, &mut watch, None)?;
            if session.close(end, &mut watch, None)? {
                break;
            }
        }
        Ok((!stopped).then_some(session.state.passes))
    }
}

/// An integrator that notes when it has learned enough.
struct Trainee<'a> {
    integrator: &'a mut dyn Integrator,
    learned: &'a AtomicBool,
}

impl Integrator for Trainee<'_> {
    fn estimate(&self, draws: &Draws<'_>, log: &mut Worker) -> Estimate {
        self.integrator.estimate(draws, log)
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        self.integrator.features_alone(draws)
    }

    fn wants_training(&self) -> bool {
        self.integrator.wants_training()
    }

    fn learn(&mut self, pass: &TrainingData) {
        self.integrator.learn(pass);
        self.learned.store(!self.integrator.wants_training(), Ordering::Relaxed);
    }

    fn prepares(&self) -> Prepares {
        self.integrator.prepares()
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> Prepared {
        self.integrator.prepare(pass)
    }
}

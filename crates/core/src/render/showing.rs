//! A session's calls of its monitor.

use super::team::Team;
use super::{Monitor, Session, Status};
use crate::Error;

impl Session<'_> {
    /// Calls the monitor between two slices.
    pub(super) fn show<T>(
        &mut self,
        monitor: &mut dyn Monitor,
        show: impl FnOnce(&mut dyn Monitor, &Status<'_>) -> T,
    ) -> T {
        let seconds = self.clock.seconds();
        let view = self.view(seconds);
        let status = Status {
            film: view.film,
            round: view.round,
            samples: self.everyones.unwrap_or(view.film.record.samples),
            expected: view.total,
            seconds,
            seconds_limit: self.meter.seconds(),
            filter_seconds: self.meter.filter_seconds(),
            view,
        };
        let answer = show(monitor, &status);
        self.clock.leave_out_since(seconds);
        answer
    }

    /// Gives the state of all to the monitors that save it.
    pub(super) fn save(&mut self, monitor: &mut dyn Monitor, team: &mut Team<'_>) -> Result<(), Error> {
        let seconds = self.clock.seconds();
        let view = self.view(seconds);
        let saves = monitor.saves();
        let mut take = |bytes: &[u8], length: u64| monitor.saved(bytes, length);
        view.stream(&mut *team.exchange, if saves { Some(&mut take) } else { None })?;
        self.clock.leave_out_since(seconds);
        Ok(())
    }

    /// Gives everyone's rows to the monitors that read them.
    pub(super) fn show_rows(&mut self, monitor: &mut dyn Monitor, team: &mut Team<'_>) -> Result<(), Error> {
        let seconds = self.clock.seconds();
        team.show_rows(&self.state.film, monitor)?;
        self.clock.leave_out_since(seconds);
        Ok(())
    }

    /// Shows the end of the render to the monitor. A resumed render plans the last round again, so the snapshot has no
    /// budget for it.
    pub(super) fn show_end(&mut self, monitor: &mut dyn Monitor, team: Option<&mut Team<'_>>) -> Result<(), Error> {
        let shown = self.state.film.record.budgets.pop();
        self.show(monitor, |monitor, status| monitor.end(status));
        let saved = team.map_or(Ok(()), |team| self.save(monitor, team));
        self.state.film.record.budgets.extend(shown);
        saved
    }
}

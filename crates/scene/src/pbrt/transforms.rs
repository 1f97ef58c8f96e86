//! Directives that change the current transformation matrix.

use super::directive::Directive;
use super::reader::{Reader, unknown_name};
use super::state::{Ctm, is_invertible, look_at, matrix, rotation};
use super::tokens::shown;
use crate::Source;
use glam::{DAffine3, DVec3};

impl Reader<'_> {
    /// Executes a directive that changes the current transformation matrix. Returns false, without effect, for other
    /// directives.
    pub(super) fn transform(&mut self, d: &Directive<'_>) -> bool {
        let numbers = &d.numbers;
        match d.word {
            "Identity" => self.set_ctm(Ok(DAffine3::IDENTITY), &d.source),
            "Translate" => self.concat(Ok(DAffine3::from_translation(DVec3::from_slice(numbers))), &d.source),
            "Scale" => self.concat(Ok(DAffine3::from_scale(DVec3::from_slice(numbers))), &d.source),
            "Rotate" => self.concat(rotation(numbers[0], DVec3::from_slice(&numbers[1..])), &d.source),
            "LookAt" => {
                let point = |i| DVec3::from_slice(&numbers[i..]);
                self.concat(look_at(point(0), point(3), point(6)), &d.source);
            }
            "Transform" => self.set_ctm(matrix(numbers), &d.source),
            "ConcatTransform" => self.concat(matrix(numbers), &d.source),
            "CoordinateSystem" => {
                self.spaces.insert(d.texts[0].clone(), [self.state.ctm.start, self.state.ctm.end]);
            }
            "CoordSysTransform" => self.enter_space(&d.texts[0], &d.source),
            "ActiveTransform" => match d.texts[0].as_str() {
                "All" => self.state.ctm.active = [true, true],
                "StartTime" => self.state.ctm.active = [true, false],
                "EndTime" => self.state.ctm.active = [false, true],
                word => {
                    let what = format!("ActiveTransform takes All, StartTime or EndTime, not {}", shown(word));
                    self.log.problem(&d.source, what);
                }
            },
            _ => return false,
        }
        true
    }

    /// Executes `TransformTimes`: sets the start and end times of the motion.
    pub(super) fn set_times(&mut self, d: &Directive<'_>) {
        self.meet("TransformTimes", &d.source);
        let times = [d.numbers[0], d.numbers[1]];
        if times[0] < times[1] {
            self.scene.motion_times = times;
        } else {
            let what = format!("TransformTimes takes a start before an end, not {} and {}", times[0], times[1]);
            self.log.problem(&d.source, what);
        }
    }

    fn concat(&mut self, transform: Result<DAffine3, String>, source: &Source) {
        self.change_ctm(transform, |old, change| old * change, source);
    }

    fn set_ctm(&mut self, transform: Result<DAffine3, String>, source: &Source) {
        self.change_ctm(transform, |_, new| new, source);
    }

    fn change_ctm(
        &mut self,
        transform: Result<DAffine3, String>,
        combine: fn(DAffine3, DAffine3) -> DAffine3,
        source: &Source,
    ) {
        match transform {
            Ok(transform) => {
                let Ctm { start, end, active } = self.state.ctm;
                let change = |old: DAffine3, active| if active { combine(old, transform) } else { old };
                let changed = Ctm { start: change(start, active[0]), end: change(end, active[1]), active };
                if is_invertible(&changed.start) && is_invertible(&changed.end) {
                    self.state.ctm = changed;
                } else {
                    let what = "with this, the transform flattens space or overflows; it must have an inverse";
                    self.log.problem(source, what);
                }
            }
            Err(message) => self.log.problem(source, message),
        }
    }

    /// Defines the coordinate system `name` by its transforms to world space at the start and at the end of the motion.
    pub(super) fn name_space(&mut self, name: &str, to_world: [DAffine3; 2]) {
        self.spaces.insert(name.to_owned(), to_world);
    }

    fn enter_space(&mut self, name: &str, source: &Source) {
        if let Some(&[start, end]) = self.spaces.get(name) {
            self.state.ctm = Ctm { start, end, ..self.state.ctm };
            return;
        }
        let what = unknown_name("coordinate system", name, self.spaces.keys(), "name it by CoordinateSystem first");
        self.log.problem(source, what);
    }
}

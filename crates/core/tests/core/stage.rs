//! Renders in stages, whose parts are bytes.

use crate::common::{Field, Independent, frame, noise};
use crate::exchange::{More, RANKS, adaptive, all, needs};
use crate::holdout::{Blur, field};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Control, Error, Film, Filter, Frame, Integrator, Limits, Needs, PilotPolicy, Render, Sampler, Shard, Stage, Status,
};

/// A render and its methods, made anew for each process.
struct Project<'a> {
    frame: Frame,
    limits: &'a Limits,
    needs: Needs,
    filter: Option<&'a dyn Filter>,
    integrator: &'a dyn Fn() -> Box<dyn Integrator>,
    sampler: &'a dyn Fn() -> Box<dyn Sampler>,
}

impl Project<'_> {
    fn render(&self) -> Render<'_> {
        let render = Render::new(self.frame, self.limits).needs(self.needs);
        self.filter.map_or(Render::new(self.frame, self.limits).needs(self.needs), |filter| render.error_of(filter))
    }

    fn alone(&self) -> Film {
        self.render().run(&mut (self.integrator)(), &mut (self.sampler)()).unwrap()
    }

    fn first(&self) -> Stage {
        self.render().first_stage(&mut (self.integrator)(), &mut (self.sampler)()).unwrap()
    }

    fn part(&self, stage: &Stage, index: u32, of: u32) -> Vec<u8> {
        let shard = Shard::new(index, of).unwrap();
        let part = self.render().stage_part(stage, shard, &mut (self.integrator)(), &mut (self.sampler)());
        part.unwrap().expect("nothing stops it")
    }

    fn next(&self, stage: &Stage, parts: &[Vec<u8>]) -> Result<Stage, Error> {
        let stage = self.render().next_stage(stage, parts, &mut (self.integrator)(), &mut (self.sampler)())?;
        // Stages travel as bytes.
        Ok(Stage::from_bytes(&stage.to_bytes()).unwrap())
    }

    /// The film of a render in stages, each in another number of parts, and the number of stages.
    fn staged(&self, of: impl Fn(u32) -> u32) -> (Film, u32) {
        let mut stage = self.first();
        while !stage.is_done() {
            let of = of(stage.number());
            let mut parts: Vec<_> = (0..of).map(|index| self.part(&stage, index, of)).collect();
            parts.rotate_left(of as usize / 2);
            stage = self.next(&stage, &parts).unwrap();
        }
        let snapshot = stage.snapshot().unwrap();
        (self.render().resume(snapshot, &mut (self.integrator)(), &mut (self.sampler)()).unwrap(), stage.number())
    }
}

fn learning(limits: &Limits) -> Project<'_> {
    Project {
        frame: frame(17, 70),
        limits,
        needs: needs(),
        filter: None,
        integrator: &|| Box::new(More::default()),
        sampler: &|| Box::new(adaptive(PilotPolicy::Keep)),
    }
}

#[test]
fn a_render_in_stages_has_the_bits_of_one_process() {
    let limits = Limits::samples(17 * 70 * 17 + 5);
    let project = learning(&limits);
    let alone = all(&project.alone());
    for of in RANKS {
        let (film, stages) = project.staged(|_| of);
        assert!(all(&film) == alone, "{of} parts");
        // Passes of 1, 1 and 2 samples in the pilot, one more in the next round, and what is left of each round.
        assert!(stages > 4, "{stages} stages");
    }
    let (film, _) = project.staged(|stage| RANKS[stage as usize % 4]);
    assert!(all(&film) == alone);
}

/// The plans of these stages hold the rows of each band apart, so that a part makes room for its own only.
#[test]
fn a_part_has_planes_for_its_bands_only() {
    let limits = Limits::samples(17 * 70 * 17);
    let integrator = || Box::new(Field(noise)) as Box<dyn Integrator>;
    let project = Project { needs: Needs::none().with_variance(), integrator: &integrator, ..learning(&limits) };
    let stage = project.next(&project.first(), &[project.part(&project.first(), 0, 1)]).unwrap();
    let mut rows = 0;
    for index in 0..3 {
        let (shard, mut most) = (Shard::new(index, 3).unwrap(), 0);
        let mut watch = |status: &Status<'_>| {
            most = most.max(status.film.bytes());
            Control::Continue
        };
        let own = stage.bands_of(shard).unwrap();
        let given = stage.bands().iter().filter(|(band, _)| own.contains(band)).cloned().collect();
        let given = Stage::from_head(&stage.head()).unwrap().with_bands(given).unwrap();
        let render = project.render().monitor(&mut watch);
        render.stage_part(&given, shard, &mut (project.integrator)(), &mut (project.sampler)()).unwrap();
        let needs = Needs::none().with_variance().and((project.sampler)().needs());
        let of_row = 17 * Film::bytes_per_pixel(&needs);
        let of_part = own.iter().map(|band| 16.min(70 - 16 * band)).sum::<usize>();
        assert_eq!(most, of_part * of_row, "part {index}");
        rows += of_part;
    }
    assert_eq!(rows, 70);
    // The negative control: a stage with all bands takes room for all.
    let mut most = 0;
    let mut watch = |status: &Status<'_>| {
        most = status.film.bytes();
        Control::Continue
    };
    let render = project.render().monitor(&mut watch);
    let shard = Shard::new(0, 3).unwrap();
    render.stage_part(&stage, shard, &mut (project.integrator)(), &mut (project.sampler)()).unwrap();
    assert_eq!(most, 17 * 70 * 56);
}

#[test]
fn a_limit_of_error_ends_stages_as_it_ends_one_process() {
    let limits = Limits::error(0.0004, 1 << 22);
    let filter = Blur { claim: Some(0.7) };
    let project = Project {
        frame: frame(48, 48),
        filter: Some(&filter),
        needs: Needs::none(),
        integrator: &|| Box::new(Field(field)),
        sampler: &|| Box::new(Uniform::new(Independent::new(5))),
        ..learning(&limits)
    };
    let alone = project.alone();
    let (film, _) = project.staged(|_| 2);
    assert!(all(&film) == all(&alone));
    assert_eq!(film.record().filtered_relmse, alone.record().filtered_relmse);
}

#[test]
fn parts_that_do_not_make_a_stage_are_refused_with_a_list() {
    let limits = Limits::samples(17 * 70 * 8);
    let project = learning(&limits);
    let first = project.first();
    let part = |index| project.part(&first, index, 3);
    let second = project.next(&first, &[part(0), part(1), part(2)]).unwrap();
    let cut = part(1)[..100].to_vec();
    let cases: [(Vec<Vec<u8>>, &[&str]); 7] = [
        (vec![], &["missing parts: all"]),
        (vec![part(2)], &["missing parts: 1/3, 2/3"]),
        (vec![part(0), part(1), part(2), part(1)], &["part 2/3 is given twice"]),
        (vec![part(0), cut, part(2)], &["they end too early"]),
        (
            vec![part(0), project.part(&first, 1, 2), part(2)],
            &["part 2/2 is of another number of parts", "missing parts: 2/3"],
        ),
        (
            vec![part(0), project.part(&second, 1, 3), part(2)],
            &["part 2/3 is of a newer plan, stage 1", "missing parts: 2/3"],
        ),
        (vec![b"nonsense".to_vec()], &["part 1 of the list cannot be read"]),
    ];
    for (parts, expected) in cases {
        let message = project.next(&first, &parts).unwrap_err().to_string();
        assert!(expected.iter().all(|expected| message.contains(expected)), "{message}");
    }
    let message = project.next(&second, &[part(0), part(1), part(2)]).unwrap_err().to_string();
    assert!(message.contains("part 1/3 is of an older plan, stage 0, and this one is at stage 1"), "{message}");
    // A part whose plan had other counts is of another render, even at the same stage.
    let more = Limits::samples(17 * 70 * 8 + 1);
    let mut other = learning(&more);
    other.sampler = &|| Box::new(Uniform::new(Independent::new(5)));
    let theirs: Vec<_> = (0..3).map(|index| other.part(&other.first(), index, 3)).collect();
    assert!(project.next(&first, &theirs).is_err());
}

#[test]
fn a_stage_needs_samples_to_trace_and_a_limit_without_a_clock() {
    let (mut integrator, mut sampler) = (Field(noise), Uniform::new(Independent::new(5)));
    let limits = Limits::seconds(1.0);
    let refused = Render::new(frame(4, 40), &limits).first_stage(&mut integrator, &mut sampler).unwrap_err();
    assert!(refused.to_string().contains("no common clock"), "{refused}");
    let limits = Limits::samples(4 * 40 * 2);
    let project = Project {
        frame: frame(4, 40),
        needs: Needs::none(),
        integrator: &|| Box::new(Field(noise)),
        sampler: &|| Box::new(Uniform::new(Independent::new(5))),
        ..learning(&limits)
    };
    let first = project.first();
    let done = project.next(&first, &[project.part(&first, 0, 1)]).unwrap();
    assert!(done.is_done());
    let shard = Shard::new(0, 1).unwrap();
    let refused = project.render().stage_part(&done, shard, &mut integrator, &mut sampler).unwrap_err();
    assert!(refused.to_string().contains("all samples are traced"), "{refused}");
    // A part that was stopped returns nothing.
    let mut stop = |_: &Status<'_>| Control::Stop;
    let part = project.render().monitor(&mut stop).stage_part(&first, shard, &mut integrator, &mut sampler).unwrap();
    assert!(part.is_none());
    for cut in [0, 7, 12, 40, first.to_bytes().len() - 1] {
        assert!(Stage::from_bytes(&first.to_bytes()[..cut]).is_err());
    }
}

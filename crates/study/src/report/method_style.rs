//! Styles of methods: colour and marker by sampler, dash by filter.

use crate::record::Method;

/// The number of the page's colours. Further samplers reuse them with other markers.
pub(super) const COLOURS: usize = 8;

/// The number of markers.
const MARKS: usize = 8;

/// Dashes of lines, `stroke-dasharray`.
pub(super) const DASHES: [&str; 5] = ["none", "7 4", "2 3", "10 3 2 3", "14 4"];

/// Indices of colour, marker and dash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MethodStyle {
    pub(super) colour: usize,
    pub(super) mark: usize,
    pub(super) dash: usize,
}

/// The styles of all methods, in their order.
pub(super) fn styles(methods: &[Method]) -> Vec<MethodStyle> {
    let mut samplers: Vec<(&str, &str)> = Vec::new();
    let mut filters: Vec<&str> = Vec::new();
    let of = |[sampler, filter]: [usize; 2]| MethodStyle {
        colour: sampler % COLOURS,
        mark: (sampler + sampler / COLOURS) % MARKS,
        dash: filter % DASHES.len(),
    };
    let places = methods.iter().map(|m| {
        [index(&mut samplers, (m.sampler.as_str(), m.points.as_str())), index(&mut filters, m.filter.as_str())]
    });
    places.map(of).collect()
}

fn index<T: PartialEq>(known: &mut Vec<T>, one: T) -> usize {
    known.iter().position(|k| *k == one).unwrap_or_else(|| {
        known.push(one);
        known.len() - 1
    })
}

/// The shortest names that tell these methods apart. Points appear only if they differ, a filter only if there is one.
pub(super) fn names(methods: &[Method]) -> Vec<String> {
    let differ = methods.iter().any(|m| m.points != methods[0].points);
    let name = |m: &Method| {
        let mut name = m.sampler.clone();
        if differ {
            name = format!("{name} / {}", m.points);
        }
        if m.filter != "none" {
            name = format!("{name} +\u{a0}{}", m.filter);
        }
        name
    };
    methods.iter().map(name).collect()
}

//! Line styles of methods in charts: colour and marker by sampler and points, dash by filter.

use crate::record::Method;

/// The number of line colours in the page. If there are more samplers, colours repeat with other markers.
pub(super) const COLOURS: usize = 8;

/// The number of marker shapes.
const MARKS: usize = 8;

/// The dash patterns of lines, as values of SVG's `stroke-dasharray`.
pub(super) const DASHES: [&str; 5] = ["none", "7 4", "2 3", "10 3 2 3", "14 4"];

/// The line style of a method: the indices of its colour, marker and dash pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MethodStyle {
    pub(super) colour: usize,
    pub(super) mark: usize,
    pub(super) dash: usize,
}

/// Chooses the styles of all methods, in the order of the methods.
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

/// Short unique names of the methods: the sampler, the point set if methods differ in it, and the filter unless it is
/// `none`.
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

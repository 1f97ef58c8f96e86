//! The place of a channel: its part, view layer, layer and view, from its name and the names in the headers.

use super::{ExrPart, Group, KNOWN_LAYERS};

/// Names of views in files without a list of views.
const EYES: [&str; 2] = ["left", "right"];

/// Groups the channels of all parts. Returns the groups and all views, the default one first.
pub(super) fn grouped(parts: &[ExrPart]) -> (Vec<Group>, Vec<String>) {
    let listed = parts.iter().flat_map(|part| part.views.iter().chain(&part.view).map(String::as_str));
    let listed: Vec<&str> = listed.collect();
    let first_of_parts = parts.iter().find_map(|part| part.views.first().or(part.view.as_ref()));
    let default = first_of_parts.cloned().unwrap_or_default();
    let views: Vec<&str> = listed.into_iter().chain(EYES).collect();
    let mut groups: Vec<Group> = Vec::new();
    for (part, about) in parts.iter().enumerate() {
        let names: Vec<&str> = about.channels.iter().map(|channel| channel.name.as_str()).collect();
        let prefix = if parts.len() > 1 { about.name.as_str() } else { "" };
        for (index, name) in names.iter().enumerate() {
            let without_dot = || without_dot(name, &names);
            let (layer, letter) = name.rsplit_once('.').unwrap_or_else(|| name.split_at(without_dot().len()));
            let channel = (letter.to_lowercase(), index);
            let mut group = place(prefix, layer, about.view.as_deref(), &views);
            if group.view.is_empty() {
                group.view.clone_from(&default);
            }
            match groups.iter_mut().find(|known| known.part == part && known.name == group.name) {
                Some(known) => known.channels.push(channel),
                None => groups.push(Group { part, channels: vec![channel], ..group }),
            }
        }
    }
    let mut views = vec![default];
    for group in &groups {
        if !views.contains(&group.view) {
            views.push(group.view.clone());
        }
    }
    (groups, views)
}

/// Creates a group without channels, from the part's name (empty if it is the only part), the layer's name, the part's view
/// and the names of all views.
fn place(part: &str, layer: &str, view_of_part: Option<&str>, views: &[&str]) -> Group {
    let mut path: Vec<&str> = layer.split('.').filter(|name| !name.is_empty()).collect();
    let mut own: Vec<&str> = part.split('.').filter(|name| !name.is_empty()).collect();
    let name = match (own.is_empty() || (path.starts_with(&own)), path.is_empty()) {
        (true, _) => layer.to_owned(),
        (false, true) => part.to_owned(),
        (false, false) => format!("{part}.{layer}"),
    };
    let known = view_of_part.as_ref().map_or(views, std::slice::from_ref);
    let view_in = |names: &mut Vec<&str>| {
        let at = names.iter().rposition(|name| known.iter().any(|view| view.eq_ignore_ascii_case(name)))?;
        Some(names.remove(at).to_owned())
    };
    let in_layer = view_in(&mut path);
    let in_part = view_in(&mut own);
    let view = view_of_part.map(str::to_owned).or(in_layer).or(in_part).unwrap_or_default();
    if let (Some(view), Some(last)) = (view_of_part, own.last_mut()) {
        // Programs name the parts of two views `rgba_left` and `rgba_right`, since names of parts must differ.
        let stem = last.strip_suffix(view).unwrap_or(last).trim_end_matches(['_', '-', ' ']);
        *last = if stem.is_empty() { last } else { stem };
    }
    if path.starts_with(&own) {
        own.clear();
    }
    let in_part = path.is_empty();
    let mut view_layer: Vec<String> = own.into_iter().chain(path).map(str::to_owned).collect();
    // A part has the name of a layer, or of a view layer whose image has no further name.
    let pass = view_layer.pop_if(|name| !in_part || is_known(name)).unwrap_or_default();
    Group { part: 0, name, view, view_layer, pass, channels: Vec::new() }
}

fn is_known(name: &str) -> bool {
    let name = name.to_lowercase();
    KNOWN_LAYERS.iter().any(|(.., names)| names.contains(&name.as_str()))
}

/// The layer of a channel without a dot: `N` for `Nx`, if `Ny` and `Nz` exist.
fn without_dot<'n>(name: &'n str, names: &[&str]) -> &'n str {
    let whole = |stem: &&str| ["x", "y", "z"].iter().all(|letter| names.contains(&format!("{stem}{letter}").as_str()));
    name.strip_suffix(['x', 'y', 'z']).filter(|stem| !stem.is_empty()).filter(whole).unwrap_or_default()
}

//! Names of materials, media and objects, which may be used before their definition, and of textures.

use super::log::Log;
use super::tokens::unknown_name;
use crate::{Color, Scalar, Source};
use std::collections::BTreeMap;

/// The names of the scene's materials, media or objects. A use before the definition reserves a place in the scene.
#[derive(Default)]
pub(super) struct Names {
    /// The index of each defined name in the scene.
    defined: BTreeMap<String, usize>,
    /// The reserved index, and the place of the first use, of each name that is not defined yet.
    awaited: BTreeMap<String, (usize, Source)>,
}

impl Names {
    /// Returns the index of a name; `None` if it is not defined yet.
    pub(super) fn get(&self, name: &str) -> Option<usize> {
        self.defined.get(name).copied()
    }

    /// Defines `name` as `item`, and stores `item` at its place in `list`. Returns its index.
    pub(super) fn define<T>(&mut self, name: &str, item: T, list: &mut Vec<T>) -> usize {
        let index = self.awaited.remove(name).map_or(list.len(), |(index, _)| index);
        self.defined.insert(name.to_owned(), index);
        match list.get_mut(index) {
            Some(place) => *place = item,
            None => list.push(item),
        }
        index
    }

    /// Returns the index of a name that is used at `source`. Reserves a place with `item` if the name has none.
    pub(super) fn used<T>(
        &mut self,
        name: &str,
        source: &Source,
        list: &mut Vec<T>,
        item: impl FnOnce(Source) -> T,
    ) -> usize {
        if let Some(index) = self.get(name).or(self.awaited.get(name).map(|(index, _)| *index)) {
            return index;
        }
        self.awaited.insert(name.to_owned(), (list.len(), source.clone()));
        list.push(item(source.clone()));
        list.len() - 1
    }

    /// Reports the names that are used but not defined, in the order of their first uses. `what` is the kind of named object,
    /// `by` the directive that defines it.
    pub(super) fn check(&self, what: &str, by: &str, log: &mut Log) {
        let mut unknown: Vec<_> = self.awaited.iter().collect();
        unknown.sort_by_key(|(_, (index, _))| *index);
        for (name, (_, source)) in unknown {
            log.problem(source, unknown_name(what, name, self.defined.keys(), &format!("define it with {by}")));
        }
    }
}

/// The textures defined so far, by name.
#[derive(Clone, Debug, Default)]
pub(super) struct Textures {
    pub(super) spectra: BTreeMap<String, Color>,
    /// Float textures by name. `Err` holds the name of an unsupported class of texture.
    pub(super) floats: BTreeMap<String, Result<Scalar, String>>,
}

impl Textures {
    /// Returns the spectrum (colour) texture with this name. The error is a message for an unknown name.
    pub(super) fn spectrum(&self, name: &str) -> Result<Color, String> {
        let wrong = self.floats.contains_key(name).then_some("it is a float texture, but a spectrum texture is needed");
        self.spectra.get(name).copied().ok_or_else(|| unknown_texture(name, self.spectra.keys(), wrong))
    }

    /// Returns the float texture with this name. The outer error is a message for an unknown name. The inner error
    /// names an unsupported class of texture.
    pub(super) fn float(&self, name: &str) -> Result<&Result<Scalar, String>, String> {
        let wrong =
            self.spectra.contains_key(name).then_some("it is a spectrum texture, but a float texture is needed");
        self.floats.get(name).ok_or_else(|| unknown_texture(name, self.floats.keys(), wrong))
    }
}

fn unknown_texture<'k>(name: &str, known: impl IntoIterator<Item = &'k String>, wrong: Option<&str>) -> String {
    unknown_name("texture", name, known, wrong.unwrap_or("define it with Texture above this line"))
}

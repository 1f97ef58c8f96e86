//! The choice of an image among the layers of a file, and of the layers that belong to it.

use super::{ExrPart, FoundLayer, Group, LayerKind, Layers, NOISY, first_moment_of, is_feature};
use LayerKind::{Color, SecondMoment};

/// The purpose for which [`Layers::image`] chooses an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// To be denoised: the noisy image of a view layer, not a composite of several.
    Denoising,
    /// To be shown, measured or used as a texture: the finished image.
    Showing,
}

/// An image chosen by [`Layers::image`].
#[derive(Clone, Debug, PartialEq)]
pub struct ChosenImage {
    /// The layer.
    pub layer: FoundLayer,
    /// Names of preferred layers that were skipped because they are 0 everywhere.
    pub empty: Vec<String>,
    /// Names of other images of the same view, except those found to be 0 everywhere.
    pub others: Vec<String>,
}

/// The reason why no image was chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoImage {
    /// No layer has the channels and the name of an image.
    Missing,
    /// Several layers may be the image; these are their names.
    Ambiguous(Vec<String>),
}

impl Layers {
    /// Chooses an image in the first view that has one: channels `R`, `G`, `B` (or `Y`) without a layer, else a layer whose
    /// name says that it is the image (such as `Combined`). For denoising, noisy images come first. Images for which `is_zero`
    /// returns true (0 everywhere) are skipped, unless all are. Without such a name, [`Purpose::Showing`] accepts the only
    /// layer with the channels of an image.
    ///
    /// # Errors
    /// Returns `Err` if `is_zero` fails, and `Ok(Err(reason))` if no image was chosen.
    pub fn image<E>(
        &self,
        purpose: Purpose,
        mut is_zero: impl FnMut(&FoundLayer) -> Result<bool, E>,
    ) -> Result<Result<ChosenImage, NoImage>, E> {
        let named = self.views.iter().map(|view| self.images(purpose, view));
        let unnamed = self.views.iter().flat_map(|view| [false, true].map(|grey| self.unnamed(view, grey)));
        let unnamed = unnamed.filter(|_| purpose == Purpose::Showing);
        let Some(mut places) = named.chain(unnamed).find(|found| !found.is_empty()) else {
            return Ok(Err(NoImage::Missing));
        };
        let rank = |images: &[FoundLayer]| self.rank(&images[0], purpose);
        places.sort_by_key(|images| rank(images));
        let mut empty = Vec::new();
        let single = places.iter().flatten().count() == 1;
        for alike in places.chunk_by(|a, b| rank(a) == rank(b)) {
            let mut full = Vec::new();
            for mut images in alike.iter().map(Vec::as_slice) {
                while let [first, rest @ ..] = images
                    && !single
                    && is_zero(first)?
                {
                    empty.push(first.shown());
                    images = rest;
                }
                full.extend(images.split_first());
            }
            match &full[..] {
                [] => {}
                [(layer, beside)] => {
                    // A finished image beside a noisy one is its denoised result, not another image.
                    let beside = beside.iter().filter(|other| self.is_noisy(other) == self.is_noisy(layer));
                    let others = beside.chain(places.iter().map(|images| &images[0])).map(FoundLayer::shown);
                    let others = others.filter(|name| *name != layer.shown() && !empty.contains(name)).collect();
                    return Ok(Ok(ChosenImage { layer: (*layer).clone(), empty, others }));
                }
                _ => return Ok(Err(NoImage::Ambiguous(full.iter().map(|(layer, _)| layer.shown()).collect()))),
            }
        }
        // All are 0 everywhere.
        Ok(Ok(ChosenImage { layer: places.swap_remove(0).swap_remove(0), empty: Vec::new(), others: Vec::new() }))
    }

    fn is_noisy(&self, image: &FoundLayer) -> bool {
        NOISY.contains(&self.groups[image.group].pass.to_lowercase().as_str())
    }

    /// The rank of an image, best first: without a view layer; a composite to be shown; others; a composite to be denoised.
    fn rank(&self, image: &FoundLayer, purpose: Purpose) -> u8 {
        let view_layer = &self.groups[image.group].view_layer;
        let is_composite = view_layer.last().is_some_and(|name| name.eq_ignore_ascii_case("composite"));
        match (is_composite, purpose) {
            _ if view_layer.is_empty() => 0,
            (true, Purpose::Showing) => 1,
            (true, Purpose::Denoising) => 3,
            (false, _) => 2,
        }
    }

    /// The images of one view that are found by name, grouped by view layer, the best one first.
    fn images(&self, purpose: Purpose, view: &str) -> Vec<Vec<FoundLayer>> {
        let names = Color.names();
        let noisy = names.iter().filter(|name| NOISY.contains(name));
        let finished = names.iter().filter(|name| !NOISY.contains(name));
        let names: Vec<&str> = match purpose {
            Purpose::Denoising => noisy.chain(finished).copied().collect(),
            Purpose::Showing => finished.chain(noisy).copied().collect(),
        };
        let order = |group: &Group| {
            let pass = group.pass.to_lowercase();
            Some((group.is_grey(), names.iter().position(|name| *name == pass)?))
        };
        let mut places: Vec<Vec<usize>> = Vec::new();
        for image in (0..self.groups.len()).filter(|&i| self.is_image(i, view) && order(&self.groups[i]).is_some()) {
            let is_here = |images: &&mut Vec<usize>| self.groups[images[0]].view_layer == self.groups[image].view_layer;
            match places.iter_mut().find(is_here) {
                Some(images) => images.push(image),
                None => places.push(vec![image]),
            }
        }
        places.iter_mut().for_each(|images| images.sort_by_key(|&i| order(&self.groups[i])));
        // View layers in the order in which their best images lie in the file.
        places.sort_by_key(|images| images[0]);
        let found = |images: Vec<usize>| images.into_iter().filter_map(|group| self.found(group, Color)).collect();
        places.into_iter().map(found).collect()
    }

    /// All layers of one view with the channels of an image, whatever their names, each in a group of its own. `grey` selects
    /// grey or coloured images.
    fn unnamed(&self, view: &str, grey: bool) -> Vec<Vec<FoundLayer>> {
        let images = (0..self.groups.len()).filter(|&i| self.is_image(i, view) && self.groups[i].is_grey() == grey);
        images.filter_map(|group| Some(vec![self.found(group, Color)?])).collect()
    }

    fn is_image(&self, group: usize, view: &str) -> bool {
        let group = &self.groups[group];
        group.view == view && group.image().is_some() && first_moment_of(&group.name).is_none()
    }

    /// Finds the layer of `kind` that belongs to `image`, by the names known for `kind`: in the view layer of `image`, else in
    /// related view layers, as a rule without an image. `None` if nothing is found, or layers of several view layers are.
    pub fn guide(&self, kind: LayerKind, image: &FoundLayer) -> Option<FoundLayer> {
        let images = self.images(Purpose::Denoising, &image.view);
        let place = &self.groups[image.group];
        let owners: Vec<&[String]> = images.iter().map(|i| &self.groups[i[0].group].view_layer[..]).collect();
        let candidates = || (0..self.groups.len()).filter(|&i| self.groups[i].view == image.view);
        let own = candidates().filter(|&i| self.groups[i].view_layer == place.view_layer);
        if let Some(found) = self.first_of(kind, own) {
            return Some(found);
        }
        let belongs = |&i: &usize| {
            let (own, other) = (&place.view_layer[..], &self.groups[i].view_layer[..]);
            let has_image = owners.contains(&other);
            let only = owners.iter().filter(|owner| **owner != own).count();
            let near = own.starts_with(other) || other.starts_with(own);
            // Some programs write the data of an image into separate parts.
            let beside = only == 0 && self.groups[i].part != place.part;
            own != other && if has_image { own.is_empty() && only == 1 } else { near || beside }
        };
        let around: Vec<usize> = candidates().filter(belongs).collect();
        let found: Vec<FoundLayer> = around.iter().filter_map(|&i| self.first_of(kind, [i].into_iter())).collect();
        let view_layer = |layer: &FoundLayer| &self.groups[layer.group].view_layer;
        let unique = found.iter().all(|layer| view_layer(layer) == view_layer(&found[0]));
        self.first_of(kind, around.into_iter()).filter(|_| unique)
    }

    /// The layer of a kind with the best name among `groups`.
    fn first_of(&self, kind: LayerKind, groups: impl Iterator<Item = usize> + Clone) -> Option<FoundLayer> {
        if kind == SecondMoment {
            return groups.filter(|&i| self.is_second_moment_of_image(i)).find_map(|i| self.found(i, kind));
        }
        let first = groups.filter(|&i| first_moment_of(&self.groups[i].name).is_none());
        kind.names().iter().find_map(|name| {
            let mut named = first.clone().filter(|&i| self.groups[i].pass.eq_ignore_ascii_case(name));
            let whole = named.find_map(|i| self.found(i, kind));
            whole.or_else(|| first.clone().find_map(|i| self.lone(i, kind, name)))
        })
    }

    fn is_second_moment_of_image(&self, group: usize) -> bool {
        let first = first_moment_of(&self.groups[group].name);
        first.is_some_and(|first| self.named(&first).is_some() && !is_feature(&first))
    }

    /// The denoised image in the view layer of a noisy `image`. `image` itself if it is not noisy or was not denoised.
    pub fn shown_beside(&self, image: &FoundLayer) -> FoundLayer {
        let place = &self.groups[image.group];
        let finished = self.images(Purpose::Showing, &image.view);
        let beside = finished.into_iter().filter_map(|images| images.into_iter().next());
        let mut beside = beside.filter(|other| self.groups[other.group].view_layer == place.view_layer);
        beside.next().filter(|_| self.is_noisy(image)).unwrap_or_else(|| image.clone())
    }

    /// `image` with its counterparts (same pass and view layer) in the other views; and the views without a counterpart.
    pub fn in_all_views(&self, image: &FoundLayer) -> (Vec<FoundLayer>, Vec<String>) {
        let place = &self.groups[image.group];
        let is = |group: &Group| group.pass.eq_ignore_ascii_case(&place.pass) && group.view_layer == place.view_layer;
        let (mut found, mut missing) = (vec![image.clone()], Vec::new());
        for view in self.views.iter().filter(|view| **view != image.view) {
            let same = self.groups.iter().position(|group| group.view == *view && is(group));
            match same.and_then(|group| self.found(group, Color)) {
                Some(layer) => found.push(layer),
                None if self.groups.iter().any(|group| group.view == *view) => missing.push(view.clone()),
                None => {}
            }
        }
        (found, missing)
    }

    /// The layer in `view` that has the pass and view layer of `layer`; `None` if the view lacks it.
    pub fn in_view(&self, layer: &FoundLayer, view: &str) -> Option<FoundLayer> {
        if layer.view == view {
            return Some(layer.clone());
        }
        let place = &self.groups[layer.group];
        let is = |group: &Group| group.pass == place.pass && group.view_layer == place.view_layer && group.view == view;
        self.found(self.groups.iter().position(is)?, layer.kind)
    }

    /// Finds the counterpart in this file of `image`, a layer of the file `of`: the layer of the same view and name, else of
    /// the same view, pass and view layer. Default views count as the same view unless both have names.
    pub fn same(&self, image: &FoundLayer, of: &Self) -> Option<FoundLayer> {
        let is_default = image.view == of.views[0] && (image.view.is_empty() || self.views[0].is_empty());
        let view = if is_default { &self.views[0] } else { &image.view };
        let place = &of.groups[image.group];
        let is = |group: &Group| {
            let is_same = group.pass.eq_ignore_ascii_case(&place.pass) && group.view_layer == place.view_layer;
            is_same && group.view == *view
        };
        let named = self.given(Color, &image.name).filter(|found| found.view == *view);
        named.or_else(|| self.found(self.groups.iter().position(is)?, Color))
    }

    /// The full name for a new channel beside `image` in `part`: the name of a channel of `image`, with the layer and letter
    /// replaced. `Front.Combined.R` becomes `Front.error.Y` for layer `error` and letter `Y`.
    pub fn channel_beside(&self, image: &FoundLayer, part: &ExrPart, layer: &str, letter: &str) -> String {
        let Group { pass, view, .. } = &self.groups[image.group];
        let mut path: Vec<&str> = part.channels[image.channels[0]].name.split('.').collect();
        path.pop();
        match path.iter().rposition(|name| name == pass) {
            Some(at) => path[at] = layer,
            // The view is the last name before the letter.
            None if path.last() == Some(&view.as_str()) => path.insert(path.len() - 1, layer),
            None => path.push(layer),
        }
        path.push(letter);
        path.join(".")
    }
}

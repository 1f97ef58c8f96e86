//! What `dapple render` would take of a scene by default, without rendering it.

use super::files::Files;
use super::memory::Expected;
use super::settings::Settings;
use super::{Options, Words, expect, needs};
use crate::{Failure, Result};
use clap::Parser;
use dapple_job::Stage;
use dapple_renderer::World;
use dapple_scene::Scene;
use std::ffi::OsStr;
use std::path::Path;
use std::sync::Arc;

/// What is known of the render before the scene becomes a world.
pub(crate) struct Foresight {
    options: Options,
    settings: Settings,
    foreseen: Expected,
}

impl Foresight {
    /// Of a scene that was read from `path`.
    ///
    /// # Errors
    ///
    /// Where its settings make no image.
    pub(crate) fn new(path: &Path, scene: &mut Scene) -> Result<Self> {
        let options = Words::try_parse_from([OsStr::new("--"), path.as_os_str()]).map_err(Failure::new)?.options;
        let settings = Settings::new(&options, scene)?;
        let foreseen = Expected::of_scene(scene, &settings.frame);
        Ok(Self { options, settings, foreseen })
    }

    /// The memory that it would take at its fullest, and what of it is for what, whether or not there is as much. Makes
    /// clusters, as the render would.
    ///
    /// # Errors
    ///
    /// Where sampler or filter cannot be made of the world.
    pub(crate) fn memory(mut self, scene: &Scene, mut world: World) -> Result<String> {
        world.set_light_selection(self.options.light_choice());
        let stage = Stage::new(Arc::new(world));
        let mut methods = self.settings.methods(&stage)?;
        let files = Files::new(&self.options, &scene.name, &self.settings)?;
        let needs = needs(&self.options, &methods, &files, stage.first_clusters().is_some());
        Ok(expect(&self.options, &self.settings, &mut methods, &files, needs, &self.foreseen)?.sum())
    }
}

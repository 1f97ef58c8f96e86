//! The live image: shown in a viewer, and written to a preview file, during the render.

mod tev;

pub(crate) use tev::Address;

use super::RenderArgs;
use crate::{Failure, Result, output};
use dapple_core::Film;
use dapple_job::{Job, RenderedImage};
use dapple_scene::image::{Image, encode_png, write_file};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tev::Viewer;

/// Default interval between two images, in seconds.
const EVERY: f64 = 2.0;
/// The largest fraction of the time that copying images may take.
const COPYING: f64 = 0.02;

/// The planes of one image.
pub(crate) struct LiveImage {
    size: [u32; 2],
    radiance: Vec<[f32; 3]>,
    counts: Vec<f32>,
    /// The predicted squared error, if the film records it.
    error: Option<Vec<f32>>,
}

/// The viewer and the preview file of a render. A separate thread sends images, so that a slow viewer or disk does not delay
/// the render.
#[derive(Default)]
pub(crate) struct Live {
    places: Option<Places>,
    worker: Option<(Sender<LiveImage>, JoinHandle<()>)>,
    is_busy: Arc<AtomicBool>,
    every: Duration,
    /// The time of the next image; `None` if none is shown.
    due: Option<Instant>,
}

/// The places where images are shown.
struct Places {
    preview: Option<PathBuf>,
    viewer: Option<Viewer>,
    exposure: f32,
}

impl Live {
    /// Connects to the viewer, if one is requested.
    pub(crate) fn open(args: &RenderArgs) -> Result<Self> {
        if !args.is_live() {
            return Ok(Self::default());
        }
        let viewer = args.view.as_ref().map(Viewer::connect).transpose().map_err(Failure::new)?;
        let every = Duration::try_from_secs_f64(args.preview_every.unwrap_or(EVERY)).unwrap_or(Duration::MAX);
        let places = Places { preview: args.preview.clone(), viewer, exposure: args.exposure };
        Ok(Self { places: Some(places), every, ..Self::default() })
    }

    /// Starts the thread that shows the images of this job.
    pub(crate) fn begin(&mut self, job: &Job) {
        let Some(mut places) = self.places.take() else { return };
        if let Some(viewer) = &mut places.viewer {
            viewer.set_name(&job.scene().name);
        }
        let (sender, images) = channel();
        let is_busy = self.is_busy.clone();
        let worker = std::thread::Builder::new().name("live image".into());
        match worker.spawn(move || places.show_all(&images, &is_busy)) {
            Ok(worker) => (self.worker, self.due) = (Some((sender, worker)), Some(Instant::now())),
            Err(e) => output::warn(format!("the live image cannot be shown: {e}; rendering continues without it")),
        }
    }

    /// Shows the image of a film, if an image is due and the previous one has been shown.
    pub(crate) fn show(&mut self, film: &Film) {
        let now = Instant::now();
        if self.due.is_some_and(|due| now >= due) && !self.is_busy.load(Ordering::Acquire) {
            self.send(LiveImage::of(film, film.image(), film.squared_errors()));
            self.due = now.checked_add(self.every.max(now.elapsed().div_f64(COPYING)));
        }
    }

    /// Shows the final image and waits until it has been shown.
    pub(crate) fn finish(&mut self, image: &RenderedImage) {
        if self.worker.is_none() {
            return;
        }
        let (filtered, film) = (&image.filtered, &image.film);
        self.send(LiveImage::of(film, filtered.radiance.clone(), filtered.error.clone()));
        if let Some((sender, worker)) = self.worker.take() {
            drop(sender);
            // A panic in the thread costs only the live image.
            let _ = worker.join();
        }
    }

    fn send(&self, image: LiveImage) {
        if let Some((sender, _)) = &self.worker {
            self.is_busy.store(true, Ordering::Release);
            // The thread ends early only if it panics.
            let _ = sender.send(image);
        }
    }
}

impl LiveImage {
    fn of(film: &Film, radiance: Vec<[f32; 3]>, error: Option<Vec<f32>>) -> Self {
        let counts = film.counts().into_iter().map(|n| n as f32).collect();
        Self { size: film.frame().size(), radiance, counts, error }
    }
}

impl Places {
    fn show_all(mut self, images: &Receiver<LiveImage>, is_busy: &AtomicBool) {
        while let Ok(image) = images.recv() {
            if let Some(viewer) = &mut self.viewer
                && let Err(e) = viewer.show(&image)
            {
                output::warn(format!("--view: {} stopped listening: {e}; rendering continues", viewer.address()));
                self.viewer = None;
            }
            if let Some(path) = &self.preview
                && let Err(e) = write_preview(path, image, self.exposure)
            {
                output::warn(format!("--preview: {e}; rendering continues without it"));
                self.preview = None;
            }
            is_busy.store(false, Ordering::Release);
        }
    }
}

/// Replaces the preview file atomically: writes the image under a temporary name, then renames the file.
fn write_preview(path: &Path, image: LiveImage, exposure: f32) -> std::result::Result<(), String> {
    let image = Image { size: image.size, pixels: image.radiance, alpha: Vec::new() };
    let png = encode_png(&image, exposure).map_err(|e| e.to_string())?;
    write_file(path, &png).map_err(|e| e.to_string())
}

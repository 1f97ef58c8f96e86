//! Dapple in a browser: the renderer in `host.rs` with uniform samples, and with the default sampler and filter.
//!
//! The page calls the exported functions, and reads pixels from the module's memory. Exported functions need an attribute that
//! Rust classifies as unsafe, because exported names may clash. Their code is safe.

#![expect(unsafe_code, reason = "names of exported functions")]

mod host;

use dapple::{Error, Filtered, Frame, Limits, SampleBuffers, Session};
pub use host::SIZE;
use std::cell::RefCell;

/// Two renders of the room.
pub struct Demo {
    /// Uniform samples without a filter, and the default sampler and filter.
    sessions: [Session<'static>; 2],
    images: [Filtered; 2],
    is_over: [bool; 2],
    /// The pixels of both images and of the sample map, 8 bits for each of red, green, blue and alpha.
    pixels: Vec<u8>,
}

impl Demo {
    /// Two renders of `spp` samples per pixel.
    ///
    /// # Errors
    ///
    /// For 0 samples.
    pub fn new(spp: u32, seed: u32) -> Result<Self, Error> {
        let (frame, limits) = (Frame::new(SIZE[0], SIZE[1])?, Limits::spp(spp.into()));
        let uniform = (dapple::sampler("uniform", dapple::points("sobol", seed.into())?)?, dapple::filter("none")?);
        let sessions = [
            Session::new(frame, limits.clone(), uniform)?,
            Session::new(frame, limits, dapple::default_pair(seed.into()))?,
        ];
        let black = || Filtered::new(SIZE, vec![[0.0; 3]; frame.pixels()]);
        let pixels = vec![255; 3 * 4 * frame.pixels()];
        Ok(Self { sessions, images: [black(), black()], is_over: [false; 2], pixels })
    }

    /// Traces `tiles` tiles of render `which`. Returns `true` if the render has a new image, as after each doubling of its
    /// samples.
    ///
    /// # Errors
    ///
    /// The errors of sessions.
    pub fn step(&mut self, which: usize, tiles: u32) -> Result<bool, Error> {
        let session = &mut self.sessions[which];
        let Some(round) = session.next_round()? else {
            return Ok(!std::mem::replace(&mut self.is_over[which], true));
        };
        for _ in 0..tiles {
            let Some(mut tile) = round.next_tile() else { break };
            tile.samples().for_each(|sample| tile.add(&sample, host::sample(sample.pixel(), &mut sample.rng())));
            round.submit(tile)?;
        }
        if round.left() == 0 {
            self.images[which] = round.image()?;
            return Ok(true);
        }
        Ok(false)
    }

    /// The image of render `which` at its last doubling of samples.
    pub fn image(&self, which: usize) -> &Filtered {
        &self.images[which]
    }

    /// Draws both images and the sample map of the second render.
    fn draw(&mut self) -> &[u8] {
        let film = self.sessions[1].film();
        let most = film.counts().into_iter().max().unwrap_or(1).max(1) as f32;
        let map = film.counts().into_iter().map(|n| [n as f32 / most; 3]);
        let [uniform, adaptive] = self.images.each_ref().map(|image| image.radiance.iter().copied());
        let colours = uniform.chain(adaptive).chain(map).map(|colour| colour.map(encoded));
        for (pixel, [red, green, blue]) in self.pixels.chunks_exact_mut(4).zip(colours) {
            pixel[..3].copy_from_slice(&[red, green, blue]);
        }
        &self.pixels
    }
}

/// A hash of all bits of an image.
pub fn fingerprint_of(image: &Filtered) -> u32 {
    let bits = image.radiance.iter().flatten().map(|value| value.to_bits());
    // FNV-1a, of 32 bits at a time.
    bits.fold(0x811c_9dc5, |hash: u32, bits| (hash ^ bits).wrapping_mul(0x0100_0193))
}

/// The room, denoised from the buffers of two renders with 2 uniform samples per pixel, without features.
///
/// # Errors
///
/// The errors of sessions and of [`dapple::denoise`].
pub fn denoised() -> Result<Filtered, Error> {
    let half = |seed| -> Result<_, Error> {
        let mut demo = Demo::new(2, seed)?;
        while demo.step(0, u32::MAX)? {}
        Ok(demo.image(0).radiance.clone())
    };
    let (a, b) = (half(1)?, half(2)?);
    dapple::denoise(SIZE, &SampleBuffers::new(&a, 2), &SampleBuffers::new(&b, 2)).run()
}

/// Encodes a linear value as 8-bit sRGB.
pub fn encoded(x: f32) -> u8 {
    let x = x.clamp(0.0, 1.0);
    let srgb = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * libm::powf(x, 1.0 / 2.4) - 0.055 };
    (255.0 * srgb + 0.5) as u8
}

thread_local! {
    static DEMO: RefCell<Option<Demo>> = const { RefCell::new(None) };
}

fn with<T>(work: impl FnOnce(&mut Demo) -> T) -> T {
    DEMO.with_borrow_mut(|demo| work(demo.as_mut().expect("start() comes first")))
}

/// Begins two renders of `spp` samples per pixel. Returns 1, or 0 on an error.
#[unsafe(no_mangle)]
pub extern "C" fn start(spp: u32, seed: u32) -> u32 {
    DEMO.with_borrow_mut(|demo| *demo = Demo::new(spp, seed).ok());
    DEMO.with_borrow(|demo| u32::from(demo.is_some()))
}

/// Traces `tiles` tiles of render 0 or 1. Returns 1 if the render has a new image, 2 if it is finished, 3 on an error, else 0.
#[unsafe(no_mangle)]
pub extern "C" fn step(which: u32, tiles: u32) -> u32 {
    with(|demo| match demo.step(which as usize, tiles) {
        Ok(_) if demo.is_over[which as usize] => 2,
        Ok(is_new) => u32::from(is_new),
        Err(_) => 3,
    })
}

/// Draws both images and the sample map, one after the other. Returns the address of the pixels in the module's memory.
#[unsafe(no_mangle)]
pub extern "C" fn draw() -> *const u8 {
    with(|demo| demo.draw().as_ptr())
}

/// The samples per pixel of render 0 or 1 so far.
#[unsafe(no_mangle)]
pub extern "C" fn spp(which: u32) -> f64 {
    let pixels = f64::from(SIZE[0] * SIZE[1]);
    with(|demo| demo.sessions[which as usize].film().record().samples as f64 / pixels)
}

/// A hash of all bits of the image of render 0 or 1.
#[unsafe(no_mangle)]
pub extern "C" fn fingerprint(which: u32) -> u32 {
    with(|demo| fingerprint_of(demo.image(which as usize)))
}

/// A hash of all bits of the image denoised from buffers; 0 on an error.
#[unsafe(no_mangle)]
pub extern "C" fn denoised_fingerprint() -> u32 {
    denoised().map_or(0, |image| fingerprint_of(&image))
}

/// The width of an image in pixels.
#[unsafe(no_mangle)]
pub extern "C" fn width() -> u32 {
    SIZE[0]
}

/// The height of an image in pixels.
#[unsafe(no_mangle)]
pub extern "C" fn height() -> u32 {
    SIZE[1]
}

use dapple_core::*;
use dapple_renderer::*;
use std::io::Write;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let mut scene = pbrt::read_scene(&a[1], &pbrt::ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let (w, h, spp): (u32, u32, u64) = (a[2].parse().unwrap(), a[3].parse().unwrap(), a[4].parse().unwrap());
    scene.film.pixel_filter = scene::PixelFilter::default();
    let t = std::time::Instant::now();
    let world = World::with_resolution(&scene, [w, h]).unwrap_or_else(|e| panic!("{e}"));
    eprintln!("build {:?}", t.elapsed());
    for c in Effects::of(&scene).called() {
        eprintln!("{} {} {}", c.effect, c.because, c.source);
    }
    let mut i = integrator(&world);
    let pts = registry::points("sobol", registry::Setting { seed: 1, spp: Some(spp) }).unwrap();
    let mut s = registry::sampler(&a[5], pts).unwrap();
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(a.get(7).map_or(1, |t| t.parse().unwrap())).build_global().unwrap();
    let t = std::time::Instant::now();
    let film = {
        let _ = &pool;
        render(
            &mut *i,
            &mut *s,
            Needs::none(),
            Frame::new(w, h).unwrap(),
            &Limits::samples(spp * w as u64 * h as u64),
            &mut NoWatch,
        )
    }
    .unwrap();
    let e = t.elapsed().as_secs_f64();
    let r = film.record();
    eprintln!(
        "{} samples {:.2}s {:.3} M/s {:.2} rays/sample {:.1} ns/ray rejected {} blocks/s {:.2}",
        r.samples,
        e,
        r.samples as f64 / e / 1e6,
        r.rays as f64 / r.samples as f64,
        e * 1e9 / r.rays as f64,
        r.rejected,
        r.blocks as f64 / r.samples as f64
    );
    let p = film.picture();
    let mut m = [0f64; 3];
    for q in &p {
        for c in 0..3 {
            m[c] += q[c] as f64;
        }
    }
    eprintln!("mean {:?}", m.map(|x| x / p.len() as f64));
    let mut f = std::fs::File::create(&a[6]).unwrap();
    write!(f, "PF\n{w} {h}\n-1.0\n").unwrap();
    for y in (0..h as usize).rev() {
        for x in 0..w as usize {
            for c in 0..3 {
                f.write_all(&p[y * w as usize + x][c].to_le_bytes()).unwrap();
            }
        }
    }
}

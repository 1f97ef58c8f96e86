//! Input that is refused, and rays that hit nothing.

use crate::support::{geometry, lat_long};
use dapple_geometry::{Disk, Error, Mesh, Ray, Sphere};
use glam::{DAffine3, DVec3, Vec3};

#[test]
fn vertices_that_are_not_finite_are_refused_by_name_g11() {
    let (positions, mut triangles) = lat_long(10, 1.0, DVec3::ZERO);
    let new = positions.len() as u32;
    triangles.push([new, new + 1, new + 2]);
    let number = triangles.len() as u32 - 1;
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let good = [0.5, 0.5, 0.5];
    for bad in [[nan, 0.0, 0.0], [nan; 3], [0.0, inf, 0.0], [0.0, 0.0, -inf]] {
        for place in 0..3 {
            let mut corners = [good; 3];
            corners[place as usize] = bad;
            let positions = [positions.clone(), corners.to_vec()].concat();
            let error = Mesh::new(positions, triangles.clone()).expect_err("not finite");
            assert_eq!(error, Error::NonFinite { triangle: number, vertex: new + place });
        }
    }
    let positions = [positions, vec![good; 2]].concat();
    let error = Mesh::new(positions, triangles).expect_err("out of range");
    assert_eq!(error, Error::IndexOutOfRange { triangle: number, vertex: new + 2, vertices: new as usize + 2 });
}

#[test]
fn magnitudes_out_of_range_are_refused() {
    for size in [1e-30_f32, 1e18, 1e38, f32::MAX] {
        let mesh = Mesh::new(vec![[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]], vec![[0, 1, 2]]);
        assert!(matches!(mesh, Err(Error::ScaleOutOfRange { .. })), "{size}");
        let sphere = Sphere::new(Vec3::ZERO, size);
        assert!(matches!(sphere, Err(Error::ScaleOutOfRange { .. })), "{size}");
    }
    for radius in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(Sphere::new(Vec3::ZERO, radius).is_err() && Disk::new(Vec3::ZERO, Vec3::X, radius, 0.0).is_err());
    }
    for inner in [1.0, 2.0, -0.1, f32::NAN] {
        assert!(Disk::new(Vec3::ZERO, Vec3::X, 1.0, inner).is_err(), "{inner}");
    }
    assert!(Disk::new(Vec3::ZERO, Vec3::ZERO, 1.0, 0.0).is_err());
    assert!(Sphere::new(Vec3::splat(f32::NAN), 1.0).is_err());
    for map in [DAffine3::ZERO, DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)), DAffine3::NAN] {
        assert!(Sphere::transformed(map, 1.0).is_err());
    }
}

#[test]
fn invalid_rays_hit_nothing_g17() {
    let scene = geometry(vec![lat_long(10, 1.0, DVec3::ZERO)]);
    let good = Ray::new(Vec3::ZERO, Vec3::new(0.3, -0.2, 0.9));
    assert!(scene.closest(&good).is_some() && scene.occluded(&good));
    let mut bad = Vec::new();
    for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let (mut origin, mut direction) = (good.origin, good.direction);
            (origin[axis], direction[axis]) = (x, x);
            bad.extend([Ray { origin, ..good }, Ray { direction, ..good }, Ray { origin, direction, ..good }]);
        }
        bad.push(Ray { tmin: x.abs(), ..good });
    }
    bad.extend([Vec3::ZERO, -Vec3::ZERO].map(|direction| Ray { direction, ..good }));
    let limits = [(f32::NAN, 1.0), (0.0, f32::NAN), (2.0, 1.0), (1.0, 1.0), (0.0, -1.0), (0.0, 0.0), (0.0, -0.0)];
    bad.extend(limits.map(|(tmin, tmax)| Ray { tmin, tmax, ..good }));
    for ray in bad {
        assert!(scene.closest(&ray).is_none() && !scene.occluded(&ray) && !ray.is_valid(), "{ray:?}");
    }
    assert!(good.is_valid());
    for tmin in [-0.0, -1.0, f32::NEG_INFINITY] {
        assert_eq!(scene.closest(&Ray { tmin, ..good }), scene.closest(&good), "a negative tmin is 0");
    }
    for direction in [Vec3::new(-0.0, -0.0, 1.0), Vec3::new(-0.0, 0.0, -1.0), Vec3::new(f32::MIN_POSITIVE, -1e-45, 1.0)]
    {
        assert!(scene.closest(&Ray { direction, ..good }).is_some(), "{direction}");
    }
}

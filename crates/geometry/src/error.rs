/// Why shapes were refused. Nothing is ever dropped silently, and nothing panics.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A corner of a triangle is NaN or infinite.
    #[error("vertex {vertex} of triangle {triangle} is not finite; repair the mesh or leave the triangle out")]
    NonFinite {
        /// The triangle's number in its mesh.
        triangle: u32,
        /// The vertex's number in its mesh.
        vertex: u32,
    },
    /// A coordinate or a whole shape lies outside the range in which rays are exact.
    #[error(
        "{what} {value:e} is out of range: magnitudes must lie in 1e-18..5e17; scale the scene by a power of two first"
    )]
    ScaleOutOfRange {
        /// What was out of range.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {vertex}, but the mesh has {vertices} vertices")]
    IndexOutOfRange {
        /// The triangle's number in its mesh.
        triangle: u32,
        /// The number that it names.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A parameter of a sphere or disk makes no surface.
    #[error("{what} is {value}; {expected}")]
    BadParameter {
        /// Which parameter.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// More triangles, shapes or nodes than 32-bit numbers can count.
    #[error("{count} {what} are too many, at most {limit} can be numbered; split the scene")]
    TooMany {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many there may be.
        limit: usize,
    },
    /// An instance names an object that does not exist.
    #[error("instance {instance} refers to object {object}, but there are {objects} objects")]
    NoSuchObject {
        /// The instance's number.
        instance: u32,
        /// The number that it names.
        object: u32,
        /// How many objects there are.
        objects: usize,
    },
    /// An object holds instances itself.
    #[error("object {object} is made of instances; only one level is supported: put its instances into the scene")]
    Nested {
        /// The object's number.
        object: u32,
    },
}

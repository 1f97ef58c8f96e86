/// The reason why shapes were refused. Nothing is dropped silently, and nothing panics.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A corner of a triangle is NaN or infinite.
    #[error("vertex {vertex} of triangle {triangle} is not finite; repair the mesh or leave the triangle out")]
    NonFinite {
        /// The triangle's index in its mesh.
        triangle: u32,
        /// The vertex's index in its mesh.
        vertex: u32,
    },
    /// A coordinate or a whole shape lies outside the range of exact rays.
    #[error(
        "{what} {value:e} is out of range: magnitudes must lie in 1e-18..5e17; scale the scene by a power of two first"
    )]
    ScaleOutOfRange {
        /// The name of the quantity out of range.
        what: &'static str,
        /// The value out of range.
        value: f64,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error(
        "triangle {triangle} refers to vertex {vertex} of {vertices}: indices count from 0 and stay below {vertices}"
    )]
    IndexOutOfRange {
        /// The triangle's index in its mesh.
        triangle: u32,
        /// The index of the missing vertex.
        vertex: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// A parameter of a shape or a motion is invalid.
    #[error("{what} is {value}; {expected}")]
    BadParameter {
        /// The name of the parameter.
        what: &'static str,
        /// The invalid value.
        value: f64,
        /// The requirement that the value fails, as a clause for the message.
        expected: &'static str,
    },
    /// There are more triangles, shapes or nodes than 32-bit numbers can count.
    #[error("{count} {what} are too many, at most {limit} can be numbered; split the scene")]
    TooMany {
        /// The kind of things counted, such as "shapes".
        what: &'static str,
        /// The number of things found.
        count: usize,
        /// The largest possible number.
        limit: usize,
    },
    /// An instance refers to an object that does not exist.
    #[error(
        "instance {instance} refers to object {object} of {objects}: indices count from 0 and stay below {objects}"
    )]
    NoSuchObject {
        /// The instance's index.
        instance: u32,
        /// The index of the missing object.
        object: u32,
        /// The number of objects.
        objects: usize,
    },
    /// An object contains instances itself.
    #[error("object {object} is made of instances; only one level is supported: put its instances into the scene")]
    Nested {
        /// The object's index.
        object: u32,
    },
}

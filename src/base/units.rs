//! Units and axes of a model's coordinates.

/// The axis that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum UpAxis {
    /// The file does not say.
    #[default]
    Unknown = 0,
    /// X.
    X = 1,
    /// Y (glTF).
    Y = 2,
    /// Z (STL by convention).
    Z = 3,
}

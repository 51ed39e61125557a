//! The error type of the crate. Messages state what was found and what was expected.

use std::io;

use thiserror::Error;

/// Result of the fallible functions of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Defect of a load step that a shorter one may avoid.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum StepDefect {
    /// A shape and the surface pass through each other without contact.
    #[error("a shape and the surface pass through each other")]
    PassedSurface,
    /// A shape passes over the faces that are held.
    #[error("a shape passes through what holds the body")]
    PassedBacking,
    /// A shape ends wholly inside the body, where it touches no contact point.
    #[error("a shape ends wholly inside the body")]
    Engulfed,
    /// Contact forces that are not finite.
    #[error("the contact forces are not finite")]
    NotFinite,
    /// More work than the resolution of the contact allows.
    #[error("contact takes more work than its resolution allows")]
    OverWorkLimit,
}

/// Reason why something could not be built or computed.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Error {
    /// A number, name or combination of options that is not accepted.
    #[error("{name}: found {found}, expected {expected}")]
    Invalid {
        /// Name of the argument, as the user wrote it.
        name: String,
        /// Value given.
        found: String,
        /// Values that are accepted.
        expected: String,
    },
    /// Settings that could not be read at all: an unknown name, a wrong type.
    #[error("{name}: {reason}")]
    Setting {
        /// Path of the setting.
        name: String,
        /// Message with the value found and the value expected.
        reason: String,
    },
    /// A snapshot that does not fit the environment it is given to.
    #[error("state: {reason}")]
    BadState {
        /// Description of the defect.
        reason: String,
    },
    /// A surface or volume mesh that cannot be used.
    #[error("mesh {name}: {reason}")]
    BadMesh {
        /// File or shape that the mesh came from.
        name: String,
        /// Description of the defect, with numbers.
        reason: String,
    },
    /// A file that could not be read or written.
    #[error("{path}: {reason}")]
    File {
        /// The path as given.
        path: String,
        /// Message of the operating system or the parser.
        reason: String,
    },
    /// The iterations did not reach equilibrium, even with the smallest load step.
    #[error(
        "no equilibrium after {iterations} iterations: residual {residual:.2e} N, \
         tolerance {tolerance:.2e} N"
    )]
    NotConverged {
        /// Newton steps, or sweeps of Gauss-Seidel, taken.
        iterations: usize,
        /// Norm of the residual force (N).
        residual: f64,
        /// Largest norm accepted (N).
        tolerance: f64,
    },
    /// A load step that ends where no shape can get by pressing, even the smallest.
    #[error("no load step is short enough: {defect}")]
    StepTooLong {
        /// Defect of the step.
        defect: StepDefect,
    },
    /// A displacement field that inverts a tetrahedron.
    #[error("the answer turns a tetrahedron inside out, expected a press in reach of the model")]
    Inverted,
    /// An equilibrium in which a shape penetrates the body deeply, for example because it was moved
    /// through nodes that are held fixed, or is narrower than contact points are apart.
    #[error("a shape stands {depth:.2e} m inside the body, expected {most:.2e} m or less")]
    Penetrated {
        /// Depth of the deepest touching point, or of the end of the shape under the skin (m).
        depth: f64,
        /// Largest depth accepted (m).
        most: f64,
    },
    /// A press mostly on the walls of a pad, by a model with contact on its face alone.
    #[error(
        "{:.0} % of the contact is on the upright sides of the pad, expected less than half: this \
         model feels its face alone, finite elements (Fem) its sides, too",
        100.0 * share
    )]
    OnWalls {
        /// Part of the contact that is on the walls.
        share: f64,
    },
    /// A network that could not be built, read or run.
    #[error("network: {reason}")]
    Network {
        /// Description of the defect.
        reason: String,
    },
    /// A force-driven press that does not reach the force asked for.
    #[error("force {force:.5e} N not reached: {reached:.5e} N after {travel:.3e} m")]
    Unreachable {
        /// Force asked for (N).
        force: f64,
        /// Largest force reached (N).
        reached: f64,
        /// Travel of the shapes (m).
        travel: f64,
    },
    /// A trial grasp for which the models return no solution, so that no limit can be derived from
    /// it.
    #[error("the trial grip has no answer, expected one in reach of the model")]
    NoTrial,
    /// An object that slips out of the hand or is out of its reach.
    #[error("the hand does not hold the object with {grip} N, expected one that it can grip")]
    NotHeld {
        /// Grip force of the hand (N).
        grip: f64,
    },
    /// A computation that was asked to end.
    #[error("interrupted")]
    Interrupted,
    /// An internal error (a panic) in a model.
    #[error("the model stopped on an internal error, expected none: please report it")]
    Panicked,
}

impl Error {
    /// Returns an [`Error::Invalid`] about any printable value.
    #[allow(clippy::needless_pass_by_value)] // Reads better at the hundred places that call it.
    pub fn invalid(
        name: impl Into<String>,
        found: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Self {
        Self::Invalid { name: name.into(), found: found.to_string(), expected: expected.into() }
    }

    /// Returns this error with `name` in place of the argument's name.
    #[must_use]
    pub fn renamed(self, name: &str) -> Self {
        match self {
            Self::Invalid { found, expected, .. } => {
                Self::Invalid { name: name.to_owned(), found, expected }
            }
            other => other,
        }
    }

    /// Returns this error with a `hint` after what was expected.
    #[must_use]
    pub fn hinting(self, hint: &str) -> Self {
        match self {
            Self::Invalid { name, found, expected } => {
                Self::Invalid { name, found, expected: format!("{expected}; {hint}") }
            }
            other => other,
        }
    }

    /// Returns this error with the argument named as a part of `whole`: `whole.name`.
    #[must_use]
    pub fn within(self, whole: &str) -> Self {
        match self {
            Self::Invalid { name, found, expected } => {
                Self::Invalid { name: format!("{whole}.{name}"), found, expected }
            }
            other => other,
        }
    }

    /// Returns this error about a mesh with the mesh named by its `file`.
    #[must_use]
    pub fn of_mesh(self, file: &str) -> Self {
        match self {
            Self::BadMesh { reason, .. } => Self::BadMesh { name: file.to_owned(), reason },
            other => other,
        }
    }

    /// Path of a file or folder that does not exist, if that is why it could not be read or written.
    pub fn missing_file(&self) -> Option<&str> {
        /// The system's number of this error; readers of files pass on its text alone.
        const NOT_FOUND: i32 = 2;
        let text = io::Error::from_raw_os_error(NOT_FOUND).to_string();
        match self {
            Self::File { path, reason } if *reason == text => Some(path),
            _ => None,
        }
    }

    /// Returns an [`Error::File`] from a path, or a name in its place, and any printable reason.
    #[allow(clippy::needless_pass_by_value)] // As for `invalid`.
    pub(crate) fn file(path: impl AsRef<std::path::Path>, reason: impl std::fmt::Display) -> Self {
        Self::File { path: path.as_ref().display().to_string(), reason: reason.to_string() }
    }
}

/// Returns an error unless a setting lies within `least` and `most`, both included.
pub(crate) fn within<T: PartialOrd + Copy + std::fmt::Display>(
    name: &str,
    value: T,
    [least, most]: [T; 2],
) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(Error::invalid(name, value, format!("{least} to {most}")))
}

/// Returns an error unless a setting is a finite number above 0.
pub(crate) fn positive(name: &str, value: f64) -> Result<()> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::invalid(name, value, "a number above 0"))
}

/// Defines the names of all kinds of [`Error`].
macro_rules! kinds {
    ($($kind:ident: $name:literal),* $(,)?) => {
        impl Error {
            /// Names of all kinds of failure, as used in Python.
            pub const KINDS: &[&'static str] = &[$($name),*];

            /// Name of the kind of failure, one of [`Error::KINDS`].
            pub fn kind(&self) -> &'static str {
                match self {
                    $(Self::$kind { .. } => $name),*
                }
            }
        }
    };
}

kinds! {
    Invalid: "invalid",
    Setting: "setting",
    BadState: "bad-state",
    BadMesh: "bad-mesh",
    File: "file",
    NotConverged: "not-converged",
    StepTooLong: "step-too-long",
    Inverted: "inverted",
    Penetrated: "penetrated",
    OnWalls: "on-walls",
    Network: "network",
    Unreachable: "unreachable",
    NoTrial: "no-trial",
    NotHeld: "not-held",
    Interrupted: "interrupted",
    Panicked: "panicked",
}

impl From<candle_core::Error> for Error {
    fn from(error: candle_core::Error) -> Self {
        Self::Network { reason: error.to_string() }
    }
}

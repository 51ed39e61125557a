//! The one error type. A message says what was found and what was expected.

use thiserror::Error;

/// Result of everything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// Why something could not be built or computed.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Error {
    /// A number, name or combination of options that makes no sense.
    #[error("{name}: found {found}, expected {expected}")]
    Invalid {
        /// The argument, as the user wrote it.
        name: String,
        /// What was given.
        found: String,
        /// What would have been accepted.
        expected: String,
    },
    /// Settings that could not be read at all: an unknown name, a wrong type.
    #[error("{name}: {reason}")]
    Setting {
        /// Path of the setting.
        name: String,
        /// What was found and what was expected.
        reason: String,
    },
    /// A snapshot that does not fit the environment it is given to.
    #[error("state: {reason}")]
    BadState {
        /// What is wrong with it.
        reason: String,
    },
    /// A surface or volume mesh that cannot be used.
    #[error("mesh {name}: {reason}")]
    BadMesh {
        /// File or shape that the mesh came from.
        name: String,
        /// What is wrong with it, with numbers.
        reason: String,
    },
    /// A file that could not be read or written.
    #[error("{path}: {reason}")]
    File {
        /// The path as given.
        path: String,
        /// What the operating system or the parser said.
        reason: String,
    },
    /// Newton's method stopped before the forces balanced, however small the load step.
    #[error(
        "no equilibrium after {iterations} Newton steps: residual {residual:.2e} N, \
         tolerance {tolerance:.2e} N"
    )]
    NotConverged {
        /// Newton steps taken, all load steps together.
        iterations: usize,
        /// Norm of the unbalanced force (N).
        residual: f64,
        /// Norm that would have been accepted (N).
        tolerance: f64,
    },
    /// An answer that turns part of the body inside out.
    #[error("the answer turns a tetrahedron inside out, expected a press in reach of the model")]
    Inverted,
    /// A balance of forces in which a shape stands deep inside the body, as when it is led through
    /// nodes that are held fixed.
    #[error("a shape stands {depth:.2e} m inside the body, expected {most:.2e} m or less")]
    Penetrated {
        /// Depth of the deepest touching point (m).
        depth: f64,
        /// Depth that would have been accepted (m).
        most: f64,
    },
    /// A network that could not be built, read or run.
    #[error("network: {reason}")]
    Network {
        /// What is wrong with it.
        reason: String,
    },
    /// A force drive whose shapes never press that hard.
    #[error("force {force:.3e} N not reached: {reached:.3e} N after {travel:.3e} m")]
    Unreachable {
        /// Force asked for (N).
        force: f64,
        /// Largest force met (N).
        reached: f64,
        /// How far the shapes moved (m).
        travel: f64,
    },
    /// A trial grip that no model answers, so that there is no limit to go by.
    #[error("the trial grip has no answer, expected one in reach of the model")]
    NoTrial,
    /// A model that stopped on an internal error.
    #[error("the model stopped on an internal error, expected none: please report it")]
    Panicked,
}

impl Error {
    /// An [`Error::Invalid`] from anything printable.
    #[allow(clippy::needless_pass_by_value)] // Reads better at the hundred places that call it.
    pub fn invalid(
        name: impl Into<String>,
        found: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Self {
        Self::Invalid { name: name.into(), found: found.to_string(), expected: expected.into() }
    }

    /// This error about the argument that the user knows as `name`.
    #[must_use]
    pub fn renamed(self, name: &str) -> Self {
        match self {
            Self::Invalid { found, expected, .. } => {
                Self::Invalid { name: name.to_owned(), found, expected }
            }
            other => other,
        }
    }

    /// This error about a part of the argument `whole`.
    #[must_use]
    pub fn within(self, whole: &str) -> Self {
        match self {
            Self::Invalid { name, found, expected } => {
                Self::Invalid { name: format!("{whole}.{name}"), found, expected }
            }
            other => other,
        }
    }

    /// An [`Error::File`] from a path and anything printable.
    pub(crate) fn file(path: &std::path::Path, reason: &dyn std::fmt::Display) -> Self {
        Self::File { path: path.display().to_string(), reason: reason.to_string() }
    }

    /// Name of the kind of failure, as Python has it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Invalid { .. } => "invalid",
            Self::Setting { .. } => "setting",
            Self::BadState { .. } => "bad-state",
            Self::BadMesh { .. } => "bad-mesh",
            Self::File { .. } => "file",
            Self::NotConverged { .. } => "not-converged",
            Self::Inverted => "inverted",
            Self::Penetrated { .. } => "penetrated",
            Self::Network { .. } => "network",
            Self::Unreachable { .. } => "unreachable",
            Self::NoTrial => "no-trial",
            Self::Panicked => "panicked",
        }
    }
}

impl From<candle_core::Error> for Error {
    fn from(error: candle_core::Error) -> Self {
        Self::Network { reason: error.to_string() }
    }
}

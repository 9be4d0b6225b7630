//! What can be wrong with a file, and where in it.

use std::fmt;
use std::io;

/// Where in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    Whole,
    /// A line of a text file, counted from 1.
    Line(u64),
    /// A byte offset.
    Byte(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Whole => Ok(()),
            Place::Line(number) => write!(f, "line {number}"),
            Place::Byte(offset) => write!(f, "byte {offset}"),
        }
    }
}

/// A file that cannot be used: the reason is a clause without a final stop.
#[derive(Debug)]
pub struct FormatError {
    pub place: Place,
    pub reason: String,
}

impl FormatError {
    pub fn new(place: Place, reason: impl Into<String>) -> Self {
        Self {
            place,
            reason: reason.into(),
        }
    }

    pub fn whole(reason: impl Into<String>) -> Self {
        Self::new(Place::Whole, reason)
    }

    pub fn line(number: u64, reason: impl Into<String>) -> Self {
        Self::new(Place::Line(number), reason)
    }

    pub fn byte(offset: u64, reason: impl Into<String>) -> Self {
        Self::new(Place::Byte(offset), reason)
    }
}

impl From<io::Error> for FormatError {
    fn from(error: io::Error) -> Self {
        Self::whole(format!("it cannot be read: {error}"))
    }
}

pub type Result<T> = std::result::Result<T, FormatError>;

/// Gives up on a file: `fail!(whole, "...")`, `fail!(line number, "...")` or `fail!(byte offset, "...")`.
macro_rules! fail {
    ($kind:ident $($place:expr)?, $($text:tt)+) => {
        return Err(crate::formats::error::FormatError::$kind($($place,)? format!($($text)+)))
    };
}
pub(crate) use fail;

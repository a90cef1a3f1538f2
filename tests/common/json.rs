//! What the program prints as JSON.

use serde_json::Value;

/// A value whose parts are known: asking for what is not there fails the test.
pub trait Known {
    /// A member of an object.
    fn at(&self, key: &str) -> &Value;
    fn number(&self) -> f64;
    fn text(&self) -> &str;
    fn truth(&self) -> bool;
}

impl Known for Value {
    #[track_caller]
    fn at(&self, key: &str) -> &Value {
        self.get(key).unwrap_or_else(|| panic!("{self} has no member {key}"))
    }

    #[track_caller]
    fn number(&self) -> f64 {
        self.as_f64().unwrap_or_else(|| panic!("{self} is no number"))
    }

    #[track_caller]
    fn text(&self) -> &str {
        self.as_str().unwrap_or_else(|| panic!("{self} is no text"))
    }

    #[track_caller]
    fn truth(&self) -> bool {
        self.as_bool().unwrap_or_else(|| panic!("{self} is no truth value"))
    }
}

/// Reads one value with nothing but white space around it.
#[track_caller]
pub fn parse(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text:?}"))
}

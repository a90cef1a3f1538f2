//! JSON objects whose members keep the order in which they are given.

use std::fmt::{Display, Write};
use std::path::Path;

/// An object under construction; members keep their order.
#[derive(Debug, Default)]
pub struct Object(String);

impl Object {
    /// An empty object.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a member whose value is JSON already, such as another object or a list.
    pub fn raw(mut self, key: &str, json: impl Display) -> Self {
        if !self.0.is_empty() {
            self.0.push(',');
        }
        let _ = write!(self.0, "{}:{json}", quoted(key));
        self
    }

    /// Adds a text.
    pub fn text(self, key: &str, value: &str) -> Self {
        self.raw(key, quoted(value))
    }

    /// Adds a file name, or `null`.
    pub fn path(self, key: &str, value: Option<&Path>) -> Self {
        match value {
            Some(path) => self.text(key, &path.to_string_lossy()),
            None => self.raw(key, "null"),
        }
    }

    /// Adds a number; `null` for one that JSON cannot express, or that there is not.
    pub fn number(self, key: &str, value: impl Into<Option<f64>>) -> Self {
        self.raw(key, number(value.into()))
    }

    /// Adds a whole number.
    pub fn count(self, key: &str, value: usize) -> Self {
        self.raw(key, value)
    }

    /// Adds a truth value.
    pub fn flag(self, key: &str, value: bool) -> Self {
        self.raw(key, value)
    }

    /// The object as JSON.
    pub fn finish(self) -> String {
        format!("{{{}}}", self.0)
    }
}

/// A list of values that are JSON already.
pub fn list(items: impl IntoIterator<Item = impl Display>) -> String {
    let items: Vec<String> = items.into_iter().map(|i| i.to_string()).collect();
    format!("[{}]", items.join(","))
}

/// A number as JSON.
pub fn number(value: Option<f64>) -> String {
    match value {
        Some(v) if v.is_finite() => v.to_string(),
        _ => "null".to_string(),
    }
}

/// A text as JSON.
pub fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_are_escaped_and_keep_their_order() {
        let inner = Object::new().flag("b", true).finish();
        let json = Object::new()
            .text("a\"", "x\\\n\u{1}é")
            .number("n", 0.25)
            .number("bad", f64::NAN)
            .number("none", None)
            .count("c", 3)
            .path("p", Some(Path::new("a b")))
            .path("q", None)
            .raw("o", inner)
            .raw("l", list([1, 2]))
            .finish();
        assert_eq!(
            json,
            "{\"a\\\"\":\"x\\\\\\n\\u0001é\",\"n\":0.25,\"bad\":null,\"none\":null,\"c\":3,\"p\":\"a b\",\"q\":null,\
             \"o\":{\"b\":true},\"l\":[1,2]}"
        );
        assert_eq!(Object::new().finish(), "{}");
    }
}

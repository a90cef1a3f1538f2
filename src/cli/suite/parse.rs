//! JSON, read back: strict, and only what lines of our own need.

use std::fmt;

/// Objects and lists within each other, at most; our own lines have four.
const DEEPEST: usize = 64;

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub enum Json {
    /// `null`
    Null,
    /// `true` or `false`
    Bool(bool),
    /// A number as it is written, so that whole numbers keep all their digits.
    Number(String),
    /// A text.
    Text(String),
    /// A list.
    List(Vec<Json>),
    /// Members in their order, each key once.
    Object(Vec<(String, Json)>),
}

/// What is wrong with a text, and at which byte of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Bytes before it.
    pub at: usize,
    /// What was expected.
    pub expected: &'static str,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} expected at byte {}", self.expected, self.at)
    }
}

impl Json {
    /// Reads one value with nothing but white space around it.
    pub fn parse(text: &str) -> Result<Json, Fault> {
        let mut reader = Reader { text, at: 0, depth: 0 };
        reader.space();
        let value = reader.value()?;
        reader.space();
        if reader.at < text.len() { reader.fault("the end") } else { Ok(value) }
    }

    /// A member of an object; `None` also where it is null.
    pub fn get(&self, key: &str) -> Option<&Json> {
        match self {
            Json::Object(members) => {
                members.iter().find(|(k, _)| k == key).map(|(_, v)| v).filter(|v| **v != Json::Null)
            }
            _ => None,
        }
    }

    /// The number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Json::Number(text) => text.parse().ok().filter(|x: &f64| x.is_finite()),
            _ => None,
        }
    }

    /// The whole number, if it is one that fits.
    pub fn whole<T: std::str::FromStr>(&self) -> Option<T> {
        match self {
            Json::Number(text) => text.parse().ok(),
            _ => None,
        }
    }

    /// The text, if it is one.
    pub fn text(&self) -> Option<&str> {
        match self {
            Json::Text(text) => Some(text),
            _ => None,
        }
    }

    /// The truth value, if it is one.
    pub fn truth(&self) -> Option<bool> {
        match self {
            Json::Bool(b) => Some(*b),
            _ => None,
        }
    }

    /// The items, if it is a list.
    pub fn list(&self) -> Option<&[Json]> {
        match self {
            Json::List(items) => Some(items),
            _ => None,
        }
    }
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
}

impl Reader<'_> {
    fn fault<T>(&self, expected: &'static str) -> Result<T, Fault> {
        Err(Fault { at: self.at, expected })
    }

    fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    fn eat(&mut self, token: &str) -> bool {
        let found = self.text[self.at..].starts_with(token);
        if found {
            self.at += token.len();
        }
        found
    }

    fn need(&mut self, token: &'static str) -> Result<(), Fault> {
        if self.eat(token) { Ok(()) } else { self.fault(token) }
    }

    fn space(&mut self) {
        while self.peek().is_some_and(|b| b" \t\r\n".contains(&b)) {
            self.at += 1;
        }
    }

    fn value(&mut self) -> Result<Json, Fault> {
        match self.peek() {
            Some(b'n') => self.need("null").map(|()| Json::Null),
            Some(b't') => self.need("true").map(|()| Json::Bool(true)),
            Some(b'f') => self.need("false").map(|()| Json::Bool(false)),
            Some(b'"') => self.string().map(Json::Text),
            Some(b'[') => {
                let mut items = Vec::new();
                self.items("]", |reader| {
                    items.push(reader.value()?);
                    Ok(())
                })?;
                Ok(Json::List(items))
            }
            Some(b'{') => {
                let mut members: Vec<(String, Json)> = Vec::new();
                self.items("}", |reader| {
                    let key = reader.string()?;
                    if members.iter().any(|(k, _)| *k == key) {
                        return reader.fault("a key that was not there before");
                    }
                    reader.space();
                    reader.need(":")?;
                    reader.space();
                    members.push((key, reader.value()?));
                    Ok(())
                })?;
                Ok(Json::Object(members))
            }
            Some(b'-' | b'0'..=b'9') => self.digits(),
            _ => self.fault("a value"),
        }
    }

    /// What is in brackets, separated by commas.
    fn items(
        &mut self,
        end: &'static str,
        mut item: impl FnMut(&mut Self) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        self.at += 1;
        self.depth += 1;
        if self.depth > DEEPEST {
            return self.fault("a value in fewer brackets");
        }
        self.space();
        if !self.eat(end) {
            loop {
                item(self)?;
                self.space();
                if self.eat(end) {
                    break;
                }
                self.need(",")?;
                self.space();
            }
        }
        self.depth -= 1;
        Ok(())
    }

    fn digits(&mut self) -> Result<Json, Fault> {
        let start = self.at;
        self.eat("-");
        let zero = self.peek() == Some(b'0');
        if self.run()? > 1 && zero {
            return self.fault("no digit after a leading 0");
        }
        if self.eat(".") {
            self.run()?;
        }
        if self.eat("e") || self.eat("E") {
            let _ = self.eat("+") || self.eat("-");
            self.run()?;
        }
        Ok(Json::Number(self.text[start..self.at].to_string()))
    }

    /// One digit or more, and how many.
    fn run(&mut self) -> Result<usize, Fault> {
        let start = self.at;
        while self.peek().is_some_and(|b| b.is_ascii_digit()) {
            self.at += 1;
        }
        if self.at == start { self.fault("a digit") } else { Ok(self.at - start) }
    }

    fn string(&mut self) -> Result<String, Fault> {
        self.need("\"")?;
        let mut out = String::new();
        loop {
            let Some(c) = self.text[self.at..].chars().next() else { return self.fault("\"") };
            if c < ' ' {
                return self.fault("an escaped control character");
            }
            self.at += c.len_utf8();
            match c {
                '"' => return Ok(out),
                '\\' => out.push(self.escape()?),
                c => out.push(c),
            }
        }
    }

    fn escape(&mut self) -> Result<char, Fault> {
        let plain = [
            ("\"", '"'),
            ("\\", '\\'),
            ("/", '/'),
            ("b", '\u{8}'),
            ("f", '\u{c}'),
            ("n", '\n'),
            ("r", '\r'),
            ("t", '\t'),
        ];
        for (letter, c) in plain {
            if self.eat(letter) {
                return Ok(c);
            }
        }
        let first = self.unit()?;
        let code = match first {
            0xd800..0xdc00 => {
                // The other half of a character beyond 16 bits.
                self.need("\\")?;
                match self.unit()? {
                    second @ 0xdc00..0xe000 => 0x10000 + ((first - 0xd800) << 10) + (second - 0xdc00),
                    _ => return self.fault("the second half of a surrogate pair"),
                }
            }
            code => code,
        };
        char::from_u32(code).map_or_else(|| self.fault("the first half of a surrogate pair"), Ok)
    }

    /// `u` and four hexadecimal digits.
    fn unit(&mut self) -> Result<u32, Fault> {
        self.need("u")?;
        let digits = self.text.as_bytes().get(self.at..self.at + 4);
        match digits.filter(|d| d.iter().all(u8::is_ascii_hexdigit)) {
            Some(_) => {
                let code = u32::from_str_radix(&self.text[self.at..self.at + 4], 16);
                self.at += 4;
                Ok(code.expect("four hexadecimal digits"))
            }
            None => self.fault("four hexadecimal digits"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::json::{Object, list, number, quoted};
    use super::*;
    use proptest::prelude::*;

    /// Writes a value with the writer of the program.
    fn write(value: &Json) -> String {
        match value {
            Json::Null => number(None),
            Json::Bool(b) => b.to_string(),
            Json::Number(text) => text.clone(),
            Json::Text(text) => quoted(text),
            Json::List(items) => list(items.iter().map(write)),
            Json::Object(members) => {
                members.iter().fold(Object::new(), |o, (k, v)| o.raw(k, write(v))).finish()
            }
        }
    }

    fn values() -> impl Strategy<Value = Json> {
        let leaf = prop_oneof![
            Just(Json::Null),
            any::<bool>().prop_map(Json::Bool),
            any::<u64>().prop_map(|i| Json::Number(i.to_string())),
            any::<f64>().prop_map(|x| {
                let text = number(Some(x));
                if text == "null" { Json::Null } else { Json::Number(text) }
            }),
            any::<String>().prop_map(Json::Text),
        ];
        leaf.prop_recursive(4, 40, 6, |inner| {
            prop_oneof![
                prop::collection::vec(inner.clone(), 0..6).prop_map(Json::List),
                prop::collection::btree_map(any::<String>(), inner, 0..6)
                    .prop_map(|m| Json::Object(m.into_iter().collect())),
            ]
        })
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(value in values()) {
            prop_assert_eq!(Json::parse(&write(&value)).unwrap(), value);
        }

        #[test]
        fn no_text_makes_it_panic(text: String, cut in 0usize..200, value in values()) {
            let _ = Json::parse(&text);
            let whole = write(&value);
            let cut = (0..=cut.min(whole.len())).rev().find(|&i| whole.is_char_boundary(i)).unwrap();
            let part = Json::parse(&whole[..cut]);
            // Of texts, lists and objects no beginning is whole.
            if cut < whole.len() && matches!(value, Json::Text(_) | Json::List(_) | Json::Object(_)) {
                prop_assert!(part.is_err());
            }
        }
    }

    #[test]
    fn what_is_not_json_is_refused() {
        let deep = "[".repeat(100_000);
        for bad in [
            "",
            "nul",
            "01",
            "1.",
            ".5",
            "+1",
            "1e",
            "--1",
            "NaN",
            "[1,]",
            "[1 2]",
            "{\"a\":1,}",
            "{\"a\"}",
            "{a:1}",
            "{\"a\":1,\"a\":2}",
            "\"a",
            "\"\\x\"",
            "\"\\u12\"",
            "\"\\ud800\"",
            "\"\\ud800\\u0041\"",
            "\"\\udc00\"",
            "\"\n\"",
            "1 2",
            "{} x",
            deep.as_str(),
        ] {
            assert!(Json::parse(bad).is_err(), "{bad:.40}");
        }
        let fault = Json::parse("[1,\n x]").unwrap_err();
        assert_eq!(fault.to_string(), "a value expected at byte 5");
    }

    #[test]
    fn members_are_found_and_typed() {
        let json =
            Json::parse(" { \"a\" : [ 1.5 , -2e3 ], \"n\":null,\"t\":\"\\ud83d\\ude00\\/\",\"b\":true } ")
                .unwrap();
        let numbers: Vec<_> = json.get("a").unwrap().list().unwrap().iter().map(Json::number).collect();
        assert_eq!(numbers, [Some(1.5), Some(-2000.0)]);
        assert_eq!((json.get("n"), json.get("x")), (None, None));
        assert_eq!(json.get("t").unwrap().text(), Some("\u{1f600}/"));
        assert_eq!(json.get("b").unwrap().truth(), Some(true));
        assert_eq!(Json::Number(u64::MAX.to_string()).whole(), Some(u64::MAX));
        assert_eq!(Json::Number("1e999".into()).number(), None);
    }
}

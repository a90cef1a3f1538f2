//! A reader of JSON that is strict about everything the program prints.

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub enum Json {
    Null,
    Bool(bool),
    Number(f64),
    Text(String),
    List(Vec<Json>),
    Object(Vec<(String, Json)>),
}

impl Json {
    /// Reads one value with nothing but white space around it.
    #[track_caller]
    pub fn parse(text: &str) -> Json {
        let mut reader = Reader { rest: text.trim() };
        let value = reader.value();
        assert!(reader.rest.is_empty(), "{:?} follows the value", reader.rest);
        value
    }

    #[track_caller]
    pub fn at(&self, key: &str) -> &Json {
        let Json::Object(members) = self else { panic!("{self:?} is no object with {key}") };
        let found: Vec<_> = members.iter().filter(|(k, _)| k == key).collect();
        assert_eq!(found.len(), 1, "{} members {key} in {members:?}", found.len());
        &found[0].1
    }

    #[track_caller]
    pub fn number(&self) -> f64 {
        let Json::Number(x) = self else { panic!("{self:?} is no number") };
        *x
    }

    #[track_caller]
    pub fn text(&self) -> &str {
        let Json::Text(s) = self else { panic!("{self:?} is no text") };
        s
    }

    #[track_caller]
    pub fn truth(&self) -> bool {
        let Json::Bool(b) = self else { panic!("{self:?} is no truth value") };
        *b
    }
}

struct Reader<'a> {
    rest: &'a str,
}

impl Reader<'_> {
    fn eat(&mut self, token: &str) -> bool {
        match self.rest.strip_prefix(token) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    #[track_caller]
    fn need(&mut self, token: &str) {
        assert!(self.eat(token), "{token} expected before {:?}", self.rest);
    }

    #[track_caller]
    fn value(&mut self) -> Json {
        if self.eat("null") {
            return Json::Null;
        }
        if self.eat("true") {
            return Json::Bool(true);
        }
        if self.eat("false") {
            return Json::Bool(false);
        }
        if self.rest.starts_with('"') {
            return Json::Text(self.string());
        }
        if self.eat("[") {
            let mut items = Vec::new();
            while !self.eat("]") {
                if !items.is_empty() {
                    self.need(",");
                }
                items.push(self.value());
            }
            return Json::List(items);
        }
        if self.eat("{") {
            let mut members = Vec::new();
            while !self.eat("}") {
                if !members.is_empty() {
                    self.need(",");
                }
                let key = self.string();
                self.need(":");
                members.push((key, self.value()));
            }
            return Json::Object(members);
        }
        let end = self.rest.find(|c: char| !"+-.eE0123456789".contains(c)).unwrap_or(self.rest.len());
        let (number, rest) = self.rest.split_at(end);
        self.rest = rest;
        Json::Number(number.parse().unwrap_or_else(|_| panic!("{number:?} before {rest:?} is no number")))
    }

    #[track_caller]
    fn string(&mut self) -> String {
        self.need("\"");
        let mut out = String::new();
        loop {
            let c = self.rest.chars().next().expect("the text ends");
            self.rest = &self.rest[c.len_utf8()..];
            match c {
                '"' => return out,
                '\\' => {
                    let e = self.rest.chars().next().expect("an escaped letter");
                    self.rest = &self.rest[e.len_utf8()..];
                    out.push(match e {
                        'n' => '\n',
                        't' => '\t',
                        'r' => '\r',
                        'u' => {
                            let (code, rest) = self.rest.split_at(4);
                            self.rest = rest;
                            char::from_u32(u32::from_str_radix(code, 16).unwrap()).unwrap()
                        }
                        '"' | '\\' => e,
                        _ => panic!("unknown escape {e}"),
                    });
                }
                c if c < ' ' => panic!("a bare control character"),
                c => out.push(c),
            }
        }
    }
}

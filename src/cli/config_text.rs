//! TOML as options: the text of a configuration file becomes keys and values for [`Config::set`].
//!
//! Uses nothing of the program, so that a fuzz target can include the file.
//!
//! [`Config::set`]: bijective_sdf::reconstruct::Config::set

use bijective_sdf::{Error, ErrorKind};
use toml::{Table, Value};

/// Reads TOML, or says in which line it is none.
pub fn parse(text: &str) -> Result<Table, Error> {
    text.parse::<Table>().map_err(|e| {
        let line = e
            .span()
            .map(|s| 1 + text.as_bytes()[..s.start.min(text.len())].iter().filter(|&&b| b == b'\n').count());
        let named = line.and_then(|line| unquoted(text.lines().nth(line - 1)?));
        let advice =
            named.map_or("`bijective-sdf config` prints a file to start from".into(), |(key, value)| {
                match value {
                    "yes" | "on" => format!("if it is meant as true or false: {key} = true"),
                    "no" => format!("if it is meant as true or false: {key} = false"),
                    _ => format!("a text needs quotes: {key} = \"{value}\""),
                }
            });
        let error = Error::new(ErrorKind::Config, format!("not TOML: {}", e.message())).advise(advice);
        match line {
            Some(line) => error.at_line(line as u64),
            None => error,
        }
    })
}

/// Key and value of a line such as `stages = 32:60`, whose value is a text without its quotes.
fn unquoted(line: &str) -> Option<(&str, &str)> {
    let (key, value) = line.split_once('=')?;
    let value = value.split('#').next()?.trim();
    let plain = |c: char| c.is_ascii_alphanumeric() || ":,._-+".contains(c);
    (!value.is_empty() && value.chars().all(plain)).then_some((key.trim(), value))
}

/// Tables and dotted keys become the dotted keys that `Config::set` knows.
pub fn flatten(prefix: &str, table: Table, out: &mut Vec<(String, String)>) -> Result<(), Error> {
    for (key, value) in table {
        let key = if prefix.is_empty() { key } else { format!("{prefix}.{key}") };
        match value {
            Value::Table(inner) => flatten(&key, inner, out)?,
            Value::Array(items) => {
                let items = items.iter().map(|v| scalar(&key, v)).collect::<Result<Vec<_>, _>>()?;
                out.push((key, items.join(",")));
            }
            value => {
                let text = scalar(&key, &value)?;
                out.push((key, text));
            }
        }
    }
    Ok(())
}

/// A single value as `Config::set` takes it.
pub fn scalar(key: &str, value: &Value) -> Result<String, Error> {
    match value {
        Value::String(s) => Ok(s.clone()),
        Value::Integer(i) => Ok(i.to_string()),
        Value::Float(f) => Ok(f.to_string()),
        Value::Boolean(b) => Ok(b.to_string()),
        _ => Err(Error::new(ErrorKind::Config, format!("{value} is no text, number or truth value"))
            .at_element(format!("option {key}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_and_dotted_keys_mean_the_same() {
        let flat = |text: &str| {
            let mut out = Vec::new();
            flatten("", parse(text).unwrap(), &mut out).unwrap();
            out
        };
        let want = [("a.b", "1"), ("a.c", "0.001"), ("on", "true"), ("s", "x:1,y:2")];
        let want: Vec<_> = want.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        assert_eq!(flat("on = true\ns = \"x:1,y:2\"\n[a]\nb = 1\nc = 1e-3\n"), want);
        assert_eq!(flat("a.b = 1\na.c = 0.001\non = true\ns = [\"x:1\", \"y:2\"]\n"), want);
        assert_eq!(flat("\"a.b\" = 1\n\"a.c\" = 0.001\non = true\ns = [\"x:1\", \"y:2\"]\n"), want);
    }

    #[test]
    fn damage_is_placed() {
        let e = parse("a = 1\nb = = 2\n").unwrap_err();
        assert_eq!((e.kind(), e.line()), (ErrorKind::Config, Some(2)));
        assert!(e.to_string().contains("config` prints a file"), "{e}");
        for bare in ["stages = 32:60,48:60 # grids", "target = surface", "clip = off"] {
            let e = parse(bare).unwrap_err().to_string();
            let quoted = bare.split(" #").next().unwrap().replacen("= ", "= \"", 1) + "\"";
            assert!(e.contains(&format!("a text needs quotes: {quoted}")), "{e}");
        }
        assert!(parse("denoise = yes").unwrap_err().to_string().contains("denoise = true"));
        let mut out = Vec::new();
        let e = flatten("", parse("a.when = 2020-01-01\n").unwrap(), &mut out).unwrap_err();
        assert!(e.to_string().contains("option a.when"), "{e}");
    }
}

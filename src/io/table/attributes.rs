//! The attributes of a table, once all rows are read: which are numbers, of which type, and which are a colour.

use super::super::Loaded;
use super::super::precision::is_short_float;
use super::columns::listed;
use crate::geometry::{Attribute, COLOUR, Number};

/// Leaves out the attributes that are words, and finds the narrowest type for those that are numbers.
pub(super) fn settle(loaded: &mut Loaded) {
    let (numbers, words): (Vec<_>, Vec<_>) = std::mem::take(&mut loaded.attributes)
        .into_iter()
        .partition(|a| a.values.iter().any(|x| x.is_finite()));
    if !words.is_empty() {
        let names: Vec<String> = words.into_iter().map(|a| a.name).collect();
        loaded.notices.push(format!("the columns {} hold no numbers", listed(&names)));
    }
    loaded.attributes = numbers;
    for attribute in &mut loaded.attributes {
        attribute.number = narrowest(&attribute.values);
    }
    let colour = ["r", "g", "b"];
    let parts = [COLOUR, colour].map(|names| {
        names.map(|name| {
            let bytes = |a: &Attribute| a.number == Number::U8 && a.name.eq_ignore_ascii_case(name);
            loaded.attributes.iter().position(bytes)
        })
    });
    if let Some([Some(r), Some(g), Some(b)]) = parts.into_iter().find(|p| p.iter().all(Option::is_some)) {
        for (i, name) in [r, g, b].into_iter().zip(COLOUR) {
            loaded.attributes[i].name = name.into();
        }
    }
}

/// A type that holds numbers exactly, or as their digits have them: the narrowest of bytes, integers of 32 bits, and
/// floats.
fn narrowest(values: &[f64]) -> Number {
    let whole = |low: f64, high: f64| values.iter().all(|x| x.fract() == 0.0 && (low..=high).contains(x));
    let mut digits = String::new();
    if whole(0.0, 255.0) {
        Number::U8
    } else if whole(f64::from(i32::MIN), f64::from(i32::MAX)) {
        Number::I32
    } else if values.iter().all(|&x| !x.is_finite() || is_short_float(x, &mut digits)) {
        Number::F32
    } else {
        Number::F64
    }
}

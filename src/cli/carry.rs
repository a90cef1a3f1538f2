//! `--carry` and `--support`: numbers that stand beside the vertices of a mesh.

use bijective_sdf::Error;
use bijective_sdf::geometry::{Attribute, Number};
use bijective_sdf::io::PointCloud;
use bijective_sdf::scene::nearest_of;

use super::Common;
use super::failure::Failure;
use super::json::{list, quoted};
use super::output::Output;

/// Points with what the vertices near them take over.
#[derive(Default)]
pub struct Carried {
    points: Vec<[f64; 3]>,
    attributes: Vec<Attribute>,
}

impl Carried {
    /// The attributes of the `kept` points (indices into the cloud) that the format of `output` can hold; and, if some
    /// or all cannot be carried, a warning, which is also printed here.
    pub fn new(cloud: PointCloud, kept: &[u32], output: &Output, common: Common) -> (Self, Option<String>) {
        let format = output.format();
        let (attributes, left): (Vec<Attribute>, Vec<Attribute>) =
            cloud.attributes.into_iter().partition(|a| format.holds_attribute(&a.name));
        let names = |of: &[Attribute]| of.iter().map(|a| a.name.as_str()).collect::<Vec<_>>().join(", ");
        let warning = if !left.is_empty() {
            Some(format!("{format} files hold colours only: not carried are {}; write ply", names(&left)))
        } else if attributes.is_empty() {
            Some(
                "nothing is carried: no numbers beside the coordinates were read; columns of a text are if a line of \
                 names comes first"
                    .into(),
            )
        } else {
            None
        };
        warning.iter().for_each(|w| common.warn(w));
        if attributes.is_empty() {
            return (Carried::default(), warning);
        }
        common.note(&format!("carried to the vertices from the nearest point: {}", names(&attributes)));
        let points = kept.iter().map(|&i| cloud.points[i as usize]).collect();
        let attributes = attributes.iter().map(|a| a.picked(kept)).collect();
        (Carried { points, attributes }, warning)
    }

    /// The attributes at places.
    pub fn at(&self, places: &[[f64; 3]]) -> Result<Vec<Attribute>, Error> {
        if self.attributes.is_empty() {
            return Ok(Vec::new());
        }
        let near = nearest_of(places, &self.points)?;
        Ok(self.attributes.iter().map(|a| Attribute { name: plain(&a.name), ..a.picked(&near) }).collect())
    }

    /// The names as a JSON list.
    pub fn json(&self) -> String {
        list(self.attributes.iter().map(|a| quoted(&a.name)))
    }
}

/// Refuses options whose results a format has no place for, before any work is done.
pub fn check_format(output: &Output, carry: bool, support: bool) -> Result<(), Failure> {
    let format = output.format();
    let refuse = |option: &str, formats: &str| {
        let text =
            format!("{option} needs a mesh with numbers at its vertices, which {format} files do not have");
        Err(Failure::Usage(format!("{text}; write {formats}")))
    };
    if support && !format.holds_attribute(SUPPORT) {
        return refuse("--support", "ply");
    }
    if carry && !format.holds_attribute("red") {
        return refuse("--carry", "ply (obj and glb hold colours)");
    }
    Ok(())
}

/// The name of the property that `--support` writes: a gap, so large where no point is near.
const SUPPORT: &str = "support";

/// All attributes of a mesh: those carried and, if asked for, the support. Where two have the same name the later gets
/// a number behind it.
pub fn vertex_attributes(support: Option<Vec<f32>>, carried: Vec<Attribute>) -> Vec<Attribute> {
    let support = support.map(|values| Attribute {
        name: SUPPORT.into(),
        number: Number::F32,
        values: values.into_iter().map(f64::from).collect(),
    });
    let mut all: Vec<Attribute> = Vec::new();
    for mut attribute in support.into_iter().chain(carried) {
        let name = attribute.name.clone();
        let mut count = 2;
        while ["x", "y", "z"].contains(&attribute.name.as_str())
            || all.iter().any(|a| a.name == attribute.name)
        {
            attribute.name = format!("{name}_{count}");
            count += 1;
        }
        all.push(attribute);
    }
    all
}

/// A name that a PLY header can have: without white space and letters beyond ASCII.
fn plain(name: &str) -> String {
    let name: String =
        name.chars().map(|c| if c.is_ascii_graphic() { c } else { '_' }).take(MAX_NAME).collect();
    if name.is_empty() { "unnamed".into() } else { name }
}

/// Characters of a name.
const MAX_NAME: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain_and_each_is_of_its_own() {
        let of = |name: &str| Attribute { name: plain(name), number: Number::U8, values: vec![1.0] };
        let carried = ["support", "größe in m", "", "x", "support"].map(of).to_vec();
        let names: Vec<String> =
            vertex_attributes(Some(vec![0.5]), carried).into_iter().map(|a| a.name).collect();
        assert_eq!(names, ["support", "support_2", "gr__e_in_m", "unnamed", "x_2", "support_3"]);
        assert!(vertex_attributes(None, Vec::new()).is_empty());
    }
}

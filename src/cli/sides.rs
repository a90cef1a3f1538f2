//! `--normals` and `--origin`: what is known of the sides of the surface.

use bijective_sdf::io::PointCloud;
use bijective_sdf::start::{behind_others, contradicting, facing};
use clap::{Args, ValueEnum};

/// What to do with the normals of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Normals {
    /// Let them decide which side of the surface is outside
    Use,
    /// Find the sides from the points alone
    #[default]
    Ignore,
}

/// How the user says where outside is.
#[derive(Clone, Copy, Debug, Args)]
pub struct SidesArgs {
    /// The normals of the file (ply, pcd, obj, off, vtk, npz, columns nx, ny and nz of a text)
    #[arg(long, value_enum, default_value_t)]
    normals: Normals,
    /// The place from which all points were seen, that of the scanner: the side of the surface that faces it is
    /// outside. With `--normals use` the normals are turned to it
    #[arg(long, value_name = "X,Y,Z", value_parser = three_numbers, allow_hyphen_values = true)]
    origin: Option<[f64; 3]>,
}

/// Three finite numbers with commas between.
pub fn three_numbers(text: &str) -> Result<[f64; 3], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|x| x.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if text.split(',').count() == 3 && numbers.iter().all(|x| x.is_finite()) => Ok([x, y, z]),
        _ => Err("three numbers with commas between expected, such as 1,1,0.5".into()),
    }
}

/// Contradicting normals, of all, from which on they are doubtful.
const DOUBTFUL: f64 = 0.03;

/// Points behind or before others, of all, from which on they have not been seen from one place. Scans of a street and
/// a room have up to 0.03; closed shapes that are seen from outside 0.09 to 0.33, less only where they are thin.
const HIDDEN: f64 = 0.1;

/// The normals that decide the sides, and what to tell.
#[derive(Debug, Default)]
pub struct Sides {
    /// Outward normals at the points, n x 3.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Where they are from, as `--json` says it.
    pub source: &'static str,
    pub warnings: Vec<String>,
    pub notes: Vec<String>,
}

impl SidesArgs {
    /// What is known of `points` (n x 3), those of a cloud that are `kept` (their numbers).
    pub fn of(&self, cloud: &PointCloud, points: &[[f64; 3]], kept: &[u32]) -> Sides {
        let mut sides = Sides { source: "points", ..Sides::default() };
        let wanted = self.normals == Normals::Use;
        let of_file: Option<Vec<[f32; 3]>> =
            cloud.normals.as_ref().map(|normals| kept.iter().map(|&i| normals[i as usize]).collect());
        match &of_file {
            None if wanted => sides.warnings.push(
                "--normals use: the file has no normals (nx, ny, nz), so the sides are found from the points"
                    .into(),
            ),
            Some(_) if !wanted && self.origin.is_none() => sides.notes.push(
                "the normals of the file are not used; --normals use lets them decide what is inside".into(),
            ),
            _ => {}
        }
        let normals = of_file.filter(|_| wanted);
        if let Some(origin) = self.origin {
            sides.source = "origin";
            let share = behind_others(points, origin);
            if share > HIDDEN {
                sides.warnings.push(format!(
                    "--origin: about {:.0} % of the points lie behind or before others as seen from there, so not all \
                     can have been; without it the sides are found from the points",
                    100.0 * share
                ));
            }
            sides.normals = Some(facing(points, normals.as_deref(), origin));
        } else if let Some(normals) = normals {
            let share = contradicting(points, &normals);
            if share > DOUBTFUL {
                sides.warnings.push(format!(
                    "{:.0} % of the normals point against those of the points around, so they may not tell inside from \
                     outside; --normals ignore finds the sides from the points",
                    100.0 * share
                ));
            }
            sides.source = "normals";
            sides.normals = Some(normals);
        }
        sides
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bijective_sdf::geometry::{AnalyticShape, widened};
    use bijective_sdf::io::read_cloud_bytes;

    #[test]
    fn three_numbers_are_parsed() {
        assert_eq!(three_numbers("1,-2.5, 3e2"), Ok([1.0, -2.5, 300.0]));
        for bad in ["", "1,2", "1,2,3,4", "1,x,2,3", "1,2,inf", "1 2 3"] {
            assert!(three_numbers(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn an_origin_that_does_not_see_all_points_is_doubted() {
        let cloud = PointCloud::default();
        let told = |points: &[[f64; 3]], origin| {
            let args = SidesArgs { normals: Normals::Ignore, origin: Some(origin) };
            let every: Vec<u32> = (0..points.len() as u32).collect();
            args.of(&cloud, points, &every).warnings
        };
        let shapes = [AnalyticShape::Sphere { radius: 1.0 }, AnalyticShape::Torus { major: 1.0, minor: 0.4 }];
        for shape in shapes {
            let (points, normals) = shape.sample(400, 2);
            let origin = [9.0, 8.0, 7.0];
            let all = widened(&points);
            assert!(told(&all, origin)[0].contains("lie behind or before others"), "{shape:?}");
            if matches!(shape, AnalyticShape::Torus { .. }) {
                continue;
            }
            // What can be seen from there, and from within.
            let seen = all
                .iter()
                .zip(&normals)
                .filter(|(p, n)| (0..3).map(|k| (origin[k] - p[k]) * f64::from(n[k])).sum::<f64>() > 0.0);
            let seen: Vec<[f64; 3]> = seen.map(|(p, _)| *p).collect();
            assert_eq!(told(&seen, origin), [""; 0], "{shape:?}");
            assert_eq!(told(&all, [0.1, 0.0, 0.0]), [""; 0], "{shape:?}");
        }
    }

    #[test]
    fn normals_and_origin_give_the_sides() {
        let (points, mut normals) = AnalyticShape::Sphere { radius: 2.0 }.sample(200, 1);
        let text = |normals: &[[f32; 3]]| {
            let row = |(p, n): (&[f32; 3], &[f32; 3])| {
                p.iter().chain(n).map(|x| format!("{x} ")).collect::<String>()
            };
            let rows: Vec<String> = points.iter().zip(normals).map(row).collect();
            read_cloud_bytes(format!("# x y z nx ny nz\n{}\n", rows.join("\n")).as_bytes(), None).unwrap()
        };
        let wide = widened(&points);
        let kept: Vec<u32> = (0..200).collect();
        let of = |cloud: &PointCloud, normals, origin| SidesArgs { normals, origin }.of(cloud, &wide, &kept);
        let cloud = text(&normals);
        let used = of(&cloud, Normals::Use, None);
        assert!(
            used.normals.as_deref() == Some(&normals[..])
                && used.warnings.is_empty()
                && used.source == "normals"
        );
        let ignored = of(&cloud, Normals::Ignore, None);
        assert!(
            ignored.normals.is_none()
                && ignored.notes[0].contains("--normals use")
                && ignored.source == "points"
        );
        let within = of(&cloud, Normals::Use, Some([0.1, 0.2, 0.3])).normals.unwrap();
        assert!(within.iter().zip(&normals).all(|(a, b)| (0..3).map(|i| a[i] * b[i]).sum::<f32>() < -0.99));
        normals.iter_mut().step_by(9).for_each(|n| *n = n.map(|x| -x));
        let odd = of(&text(&normals), Normals::Use, None);
        assert!(
            odd.warnings[0].contains("11 % of the normals") || odd.warnings[0].contains("12 %"),
            "{odd:?}"
        );
        let mut bare = cloud;
        bare.normals = None;
        let none = of(&bare, Normals::Use, None);
        assert!(none.normals.is_none() && none.warnings[0].contains("has no normals"));
    }
}

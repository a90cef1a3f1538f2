//! The cloud that is reconstructed: read, without repeated points and strays, and with what is known of its sides.

use bijective_sdf::geometry::{Bounds, clean_cloud};

use super::super::Common;
use super::super::carry::Carried;
use super::super::cleaning::{Outliers, doubts, strays, without};
use super::super::failure::Failure;
use super::super::output::Output;
use super::super::report::offset_text;
use super::ReconstructArgs;

/// Points that are ready for the work, and what there is to say about them.
pub struct PreparedCloud {
    pub points: Vec<[f64; 3]>,
    /// A normal for each point, if the user says that the file has them or where the points were seen from.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Where the sides come from, by its name in the JSON: the points, the normals, the origin.
    pub sides: &'static str,
    /// What the file has beside the coordinates, if the mesh is to have it.
    pub carried: Carried,
    /// The offset of large coordinates, about which the work is done; else 0.
    pub offset: [f64; 3],
    /// How many points repeated others.
    pub duplicates: usize,
    /// How many rows of the file hold no point.
    pub rows_left_out: usize,
    /// The places of points that seem to belong to no surface, left out or not.
    pub strays: Vec<[f64; 3]>,
    /// All warnings that were told.
    pub warnings: Vec<String>,
    /// What the reader of the file told.
    pub notices: Vec<String>,
}

impl PreparedCloud {
    /// Reads the input and makes it ready, and tells what there is to say. `mesh` is where the result goes.
    pub fn read(args: &ReconstructArgs, mesh: &Output, common: Common) -> Result<Self, Failure> {
        let input = if args.carry {
            args.reading.with_attributes(&args.input)?
        } else {
            args.reading.input(&args.input)?
        };
        let cloud = input.cloud()?;
        common.tell(&cloud.warnings, &cloud.notices);
        // The same check as the library's, here for its numbers and for an error that names the file.
        let clean = clean_cloud(&cloud.points).map_err(|e| Failure::Input(e.in_file(input.path())))?;
        // So that strays, too, do not depend on the order of the points.
        let clean = clean.sorted();
        if clean.duplicates_merged > 0 {
            common.note(&format!("left out {} points that repeat others", clean.duplicates_merged));
        }
        let (stray, told) = strays(&clean.points, args.outliers);
        let left_out = if args.outliers == Outliers::Keep { &[][..] } else { &stray };
        let points = without(&clean.points, left_out);
        let mut warnings = cloud.warnings.clone();
        let rest = clean_cloud(&points).map_err(|e| Failure::Input(e.in_file(input.path())))?;
        let doubts: Vec<String> = told.into_iter().chain(doubts(&rest, args.anisotropy.is_some())).collect();
        common.tell(&doubts, &[]);
        warnings.extend(doubts);
        let kept_points = without(&clean.given, left_out);
        let sides = args.sides.of(&cloud, &points, &kept_points);
        common.tell(&sides.warnings, &sides.notes);
        warnings.extend(sides.warnings);
        let (notices, rows_left_out) = (cloud.notices.clone(), cloud.left_out);
        let (carried, left_behind) =
            if args.carry { Carried::new(cloud, &kept_points, mesh, common) } else { Default::default() };
        warnings.extend(left_behind);
        let offset = Bounds::of(&points)?.offset();
        if offset != [0.0; 3] {
            common.note(&format!(
                "the coordinates are large: the work is done about the offset {}, which is in all results again",
                offset_text(offset)
            ));
        }
        Ok(PreparedCloud {
            points,
            normals: sides.normals,
            sides: sides.source,
            carried,
            offset,
            duplicates: clean.duplicates_merged,
            rows_left_out,
            strays: stray.iter().map(|&i| clean.points[i as usize]).collect(),
            warnings,
            notices,
        })
    }
}

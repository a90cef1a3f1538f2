//! The settings that are built in: presets and the ablations of the paper, with the paper's own figures.
//!
//! A setting changes a base configuration and nothing else, so the same list serves every preset. The figures are those
//! of the tables of Noda et al., "Learning Bijective Surface Parameterization for Inferring Signed Distance Functions
//! from Sparse Point Clouds with Grid Deformation" (CVPR 2025): means over the lamp class of ShapeNet, so the trend
//! from row to row can be compared with ours and the figures cannot.
//!
//! | settings | paper | what changes |
//! |---|---|---|
//! | `sparse` | Effect of BSP, Sparse | no S: the surface is drawn to the cloud alone |
//! | `upsample` | Effect of BSP, Upsample | S is interpolated between neighbours instead of learned; the paper has a trained upsampler (LDI) here |
//! | `single` | Effect of BSP, Single (as TPS) | one perceptron from the sphere makes S |
//! | `multiple:N` | Effect of BSP, Multiple (as AtlasNet) | N perceptrons from squares make S; `multiple` takes 20, the paper does not say |
//! | `f_offset` | Effect of GDO, f_offset | the network predicts the offsets of the grid's vertices |
//! | `f_tps` | Effect of GDO, f_TPS | no grid: L_pull takes the place of every term on the extracted surface (L_deform, the cover and the Laplacian) |
//! | `without_para` | Effect of loss functions, w/o L_para | S is made, but L_para trains it neither before nor during the training. The paper "relies solely on the sparse point cloud" here and prints the row of Sparse again, so hold its row against `sparse`, too |
//! | `without_deform` | Effect of loss functions, w/o L_deform | S is trained on L_para alone, as many steps as otherwise, and then frozen; the field is still drawn to it ("pretrained BSP as supervision without further optimization") |
//! | `without_surf` | Effect of loss functions, w/o L_surf | no L_surf; changes nothing in a preset that has none |
//! | `with_surf` | none: `Ours` of the paper has it | L_surf with the paper's weight, for presets that have none |
//! | `patch_M` | Number of KNN samples | M codes in a patch. The table is named after neighbours and is about these: "different numbers of sampled single local patches", by default 10 |
//! | `points_N` | Level of input size (pictures only) | N points sampled from the truth |
//! | `k_K` | none | K neighbours of a point in Phi; the paper gives no table |

use bijective_sdf::bsp::Parameterization;
use bijective_sdf::reconstruct::{Config, Phase};

/// What a table of the paper says: 10 x CD_L1, 100 x CD_L2, NC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    /// 10 x CD_L1.
    pub cd_l1: f64,
    /// 100 x CD_L2.
    pub cd_l2: f64,
    /// Normal consistency.
    pub nc: f64,
}

/// A row of an ablation table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ablation {
    /// The name of the setting.
    pub name: &'static str,
    /// The row's name in the paper, where it has one.
    pub row: Option<&'static str>,
    /// The row's figures.
    pub published: Option<Published>,
}

/// "Ours" in all of the paper's ablation tables, for the base itself.
pub const OURS: Published = Published { cd_l1: 0.077, cd_l2: 0.043, nc: 0.914 };

const fn row(name: &'static str, row: &'static str, cd_l1: f64, cd_l2: f64, nc: f64) -> Ablation {
    Ablation { name, row: Some(row), published: Some(Published { cd_l1, cd_l2, nc }) }
}

const fn own(name: &'static str) -> Ablation {
    Ablation { name, row: None, published: None }
}

const fn shown(name: &'static str, row: &'static str) -> Ablation {
    Ablation { name, row: Some(row), published: None }
}

/// What `--ablations` runs, in the order of the paper.
pub const ABLATIONS: &[Ablation] = &[
    row("sparse", "Sparse", 0.873, 4.315, 0.814),
    row("upsample", "Upsample", 0.427, 0.986, 0.830),
    row("single", "Single", 0.083, 0.049, 0.906),
    row("multiple", "Multiple", 0.087, 0.051, 0.901),
    row("f_tps", "f_TPS", 0.094, 0.058, 0.861),
    row("f_offset", "f_offset", 0.089, 0.055, 0.883),
    row("without_para", "w/o L_para", 0.873, 4.315, 0.814),
    row("without_deform", "w/o L_deform", 0.085, 0.053, 0.898),
    row("without_surf", "w/o L_surf", 0.081, 0.044, 0.908),
    own("with_surf"),
    row("patch_3", "3 samples", 0.086, 0.049, 0.896),
    row("patch_5", "5 samples", 0.081, 0.047, 0.905),
    row("patch_10", "10 samples", 0.077, 0.043, 0.914),
    row("patch_15", "15 samples", 0.075, 0.041, 0.914),
    shown("points_100", "input size"),
    shown("points_300", "input size"),
    shown("points_1000", "input size"),
    shown("points_3000", "input size"),
    own("k_4"),
    own("k_8"),
    own("k_16"),
    own("k_32"),
];

/// Parametric maps of `multiple`.
const MAPS: usize = 20;

/// What a built-in setting changes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changes {
    /// Options, as `--set` takes them.
    pub options: Vec<(String, String)>,
    /// Points to sample from the truth instead of reading the cloud.
    pub points: Option<usize>,
}

/// What the built-in setting of this name changes in `base`; `None` if there is none.
pub fn changes(name: &str, base: &Config) -> Option<Changes> {
    let set = |pairs: &[(&str, &str)]| {
        let options = pairs.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        Some(Changes { options, points: None })
    };
    match name {
        "sparse" => set(&[("parameterization", "none")]),
        "upsample" => set(&[("parameterization", "upsample")]),
        "single" => set(&[("parameterization", "single")]),
        "multiple" => set(&[("parameterization", &format!("multiple:{MAPS}"))]),
        "f_offset" => set(&[("deformation", "offset")]),
        "f_tps" => set(&[
            ("weights.pull", "1"),
            ("weights.deform", "0"),
            ("weights.cover", "0"),
            ("weights.laplacian", "0"),
        ]),
        "without_para" => set(&[("weights.para", "0"), ("bsp_pretrain", "0")]),
        "without_deform" => {
            let steps = pretraining(base).to_string();
            set(&[("bsp_pretrain", &steps), ("bsp_every", "never")])
        }
        "without_surf" => set(&[("weights.surf", "0")]),
        "with_surf" => set(&[("weights.surf", "0.01")]),
        _ => {
            let (family, number) = name.split_once(['_', ':'])?;
            // Not `patch_+3` or `patch_03`, which would be other names for the same.
            let number = number.parse::<usize>().ok().filter(|n| n.to_string() == number)?;
            let text = number.to_string();
            match (family, name.contains(':')) {
                ("multiple", true) => set(&[("parameterization", &format!("multiple:{text}"))]),
                ("patch", false) => set(&[("bsp.patch", &text)]),
                ("k", false) => set(&[("bsp.neighbours", &text)]),
                // However many there are, they are trained on.
                ("points", false) => {
                    set(&[("train_up_to", "all")]).map(|c| Changes { points: Some(number), ..c })
                }
                _ => None,
            }
        }
    }
}

/// As many steps as the parameterization is trained in all.
fn pretraining(base: &Config) -> usize {
    if base.parameterization == Parameterization::None {
        return 0;
    }
    let during = base.bsp_every.map_or(0, |every| base.steps_in(Phase::Train).div_ceil(every));
    base.steps_in(Phase::Pretrain) + during
}

#[cfg(test)]
mod tests {
    use super::*;
    use bijective_sdf::Preset;

    fn applied(name: &str, preset: Preset) -> Config {
        let mut config = Config::preset(preset);
        for (key, value) in changes(name, &config.clone()).unwrap().options {
            config.set(&key, &value).unwrap();
        }
        config
    }

    #[test]
    fn every_ablation_is_a_valid_change_of_every_preset_that_trains() {
        // The preset `start` trains nothing that a part could be left out of.
        for preset in Preset::ALL.into_iter().filter(|&preset| preset != Preset::Start) {
            let base = Config::preset(preset);
            for ablation in ABLATIONS {
                let name = ablation.name;
                let config = applied(name, preset);
                config.validate().unwrap_or_else(|e| panic!("{name} of {preset}: {e}"));
                // The presets have these values already.
                let trains_all = base.train_up_to.is_none() && name.starts_with("points_");
                let same = matches!(name, "patch_10" | "k_8") || trains_all;
                let surf = if base.weights.surf > 0.0 { "with_surf" } else { "without_surf" };
                assert_eq!(config == base, same || name == surf, "{name} of {preset}");
            }
        }
    }

    #[test]
    fn names_are_unique_and_families_open() {
        let base = Config::default();
        for (i, a) in ABLATIONS.iter().enumerate() {
            assert!(ABLATIONS[..i].iter().all(|b| b.name != a.name));
        }
        assert_eq!(changes("patch_7", &base).unwrap().options, [("bsp.patch".into(), "7".into())]);
        assert_eq!(changes("multiple:3", &base).unwrap().options[0].1, "multiple:3");
        assert_eq!(changes("points_50", &base).unwrap().points, Some(50));
        for none in
            ["", "patch", "patch_", "patch_x", "patch_+3", "patch_03", "patch:3", "multiple_3", "default"]
        {
            assert_eq!(changes(none, &base), None, "{none}");
        }
    }

    #[test]
    fn a_frozen_parameterization_was_trained_as_long_as_a_live_one() {
        // 30 steps before and every sixth of 120; 100 and every second of 400.
        let frozen = applied("without_deform", Preset::Default);
        assert_eq!((frozen.bsp_pretrain, frozen.bsp_every), (50, None));
        let frozen = applied("without_deform", Preset::Fine);
        assert_eq!((frozen.bsp_pretrain, frozen.bsp_every), (300, None));
        let frozen = applied("without_deform", Preset::Paper);
        assert_eq!((frozen.bsp_pretrain, frozen.bsp_every), (300, None));
        assert_eq!(frozen.weights.deform, 1.0);
    }

    #[test]
    fn the_published_figures_are_those_of_ours_where_nothing_changes() {
        let ten = ABLATIONS.iter().find(|a| a.name == "patch_10").unwrap();
        assert_eq!(ten.published, Some(OURS));
        let find = |name: &str| ABLATIONS.iter().find(|a| a.name == name).unwrap().published;
        assert_eq!(find("sparse"), find("without_para"));
    }
}

//! Colour: two lights and a soft sky, darker where the sky is hidden.

use rayon::prelude::*;

use super::camera::Camera;
use super::raster::{Buffer, Material};

/// A light far away.
struct Lamp {
    /// The direction to it in the camera's coordinates, about of length 1.
    towards: [f32; 3],
    strength: f32,
}

/// The main light.
const KEY: Lamp = Lamp { towards: [-0.45, 0.62, 0.64], strength: 0.80 };
/// The one that brightens what the main light leaves dark.
const FILL: Lamp = Lamp { towards: [0.70, 0.10, 0.71], strength: 0.22 };
/// Radius within which other surfaces hide the sky, in longest sides of the scene.
const SHADOW: f32 = 0.09;
/// Samples of the sky around each sample of the picture.
const RAYS: usize = 12;

/// What does not change from sample to sample; colours in linear light.
struct Light {
    front: [f32; 3],
    back: [f32; 3],
    ball: [f32; 3],
    top: [f32; 3],
    bottom: [f32; 3],
    half: [f32; 3],
    /// Where to look for what hides the sky, within the unit disc.
    spiral: [[f32; 2]; RAYS],
}

impl Light {
    fn new() -> Self {
        Light {
            front: srgb(120, 164, 214),
            back: srgb(222, 92, 76),
            ball: srgb(44, 92, 168),
            top: srgb(252, 253, 254),
            bottom: srgb(232, 237, 243),
            half: unit([KEY.towards[0], KEY.towards[1], KEY.towards[2] + 1.0]),
            spiral: std::array::from_fn(|k| {
                let r = ((k as f32 + 0.5) / RAYS as f32).sqrt();
                // The golden angle spreads the places evenly over the disc.
                let angle = 2.399_963_2 * k as f32;
                [r * angle.cos(), r * angle.sin()]
            }),
        }
    }
}

/// Pixels, red, green, blue, from `step` x `step` samples each.
pub fn resolve(buffer: &Buffer, camera: &Camera, step: usize) -> Vec<u8> {
    let size = camera.size();
    let width = size / step;
    let light = Light::new();
    let mut rgb = vec![0u8; 3 * width * width];
    rgb.par_chunks_mut(3 * width).enumerate().for_each(|(row, line)| {
        for (column, out) in line.chunks_exact_mut(3).enumerate() {
            let mut sum = [0.0f32; 3];
            for i in 0..step * step {
                let (y, x) = (row * step + i / step, column * step + i % step);
                let colour = sample(buffer, camera, &light, x, y);
                (0..3).for_each(|c| sum[c] += colour[c]);
            }
            for c in 0..3 {
                out[c] = encode(sum[c] / (step * step) as f32);
            }
        }
    });
    rgb
}

/// Linear light at one sample.
fn sample(buffer: &Buffer, camera: &Camera, light: &Light, x: usize, y: usize) -> [f32; 3] {
    let size = camera.size();
    let i = y * size + x;
    // White above, a little darker below.
    let down = y as f32 / size as f32;
    let background: [f32; 3] =
        std::array::from_fn(|c| light.top[c] + (light.bottom[c] - light.top[c]) * down);
    let (base, gloss) = match buffer.material[i] {
        Material::Background => return background,
        Material::Front => (light.front, 0.16),
        Material::Back => (light.back, 0.05),
        Material::Ball => (light.ball, 0.10),
    };
    let n = buffer.normal[i];
    let depth = buffer.depth[i];
    let open = 1.0 - hidden(buffer, camera, light, x, y);
    let sky = (0.30 + 0.12 * n[1]) * open;
    let diffuse = |lamp: Lamp| lamp.strength * dot(n, lamp.towards).max(0.0);
    // A hidden place also loses some direct light, which stands for shadows.
    let bright = sky + (diffuse(KEY) + diffuse(FILL)) * (0.45 + 0.55 * open);
    let shine = gloss * dot(n, light.half).max(0.0).powi(40) * open;
    // Points have no surface to hide what is behind, so distance is shown by paleness.
    let haze = match buffer.material[i] {
        Material::Ball => 0.68 * camera.backness(depth),
        _ => 0.0,
    };
    std::array::from_fn(|c| (base[c] * bright + shine) * (1.0 - haze) + background[c] * haze)
}

/// How much of the sky near surfaces hide, 0 to 1 (McGuire et al. 2011, "The Alchemy screen-space ambient obscurance").
fn hidden(buffer: &Buffer, camera: &Camera, light: &Light, x: usize, y: usize) -> f32 {
    let size = camera.size();
    let i = y * size + x;
    if buffer.material[i] == Material::Ball {
        return 0.0;
    }
    let (depth, n) = (buffer.depth[i], buffer.normal[i]);
    let middle = |k: usize| k as f32 + 0.5;
    let p = camera.unscreen(middle(x), middle(y), depth);
    let reach = SHADOW * camera.scale_at(depth);
    // The spiral of each sample is turned by its own angle; averaging the samples of a pixel hides the pattern.
    let noise = (52.982_918 * (0.067_110_56 * x as f32 + 0.005_837_15 * y as f32).fract()).fract();
    let (sin, cos) = (std::f32::consts::TAU * noise).sin_cos();
    let mut sum = 0.0;
    for [a, b] in light.spiral {
        let (sx, sy) = (x as f32 + reach * (a * cos - b * sin), y as f32 + reach * (a * sin + b * cos));
        let last = (size - 1) as f32;
        if !(0.0..=last).contains(&sx) || !(0.0..=last).contains(&sy) {
            continue;
        }
        let (sx, sy) = (sx as usize, sy as usize);
        let there = buffer.depth[sy * size + sx];
        if there.is_infinite() {
            continue;
        }
        let q = camera.unscreen(middle(sx), middle(sy), there);
        // Depth grows away from the camera, normals point towards it.
        let v = [q[0] - p[0], q[1] - p[1], p[2] - q[2]];
        let len_sq = dot(v, v);
        if len_sq < SHADOW * SHADOW * 4.0 {
            // What rises little above the tangent plane is the facets of the surface itself.
            sum += (dot(v, n) - 0.08 * len_sq.sqrt()).max(0.0) / (len_sq + 1e-4);
        }
    }
    (2.2 * SHADOW * sum / RAYS as f32).min(0.85)
}

fn srgb(r: u8, g: u8, b: u8) -> [f32; 3] {
    [r, g, b].map(|x| (f32::from(x) / 255.0).powf(2.2))
}

fn encode(linear: f32) -> u8 {
    (255.0 * linear.clamp(0.0, 1.0).powf(1.0 / 2.2)).round() as u8
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: [f32; 3]) -> [f32; 3] {
    let len = dot(a, a).sqrt();
    a.map(|x| x / len)
}

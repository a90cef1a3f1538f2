//! Which part of the scene each sample of the picture shows.

use super::camera::Camera;

/// What is seen at a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Material {
    /// Nothing.
    Background,
    /// The outside of the mesh.
    Front,
    /// The inside of the mesh.
    Back,
    /// A point of the cloud.
    Ball,
}

/// Depth, normal and material of every sample of a square picture, row by row from the top.
pub struct Buffer {
    size: usize,
    /// Distance in front of the camera; infinite for the background.
    pub depth: Vec<f32>,
    /// Unit normals towards the camera, in its coordinates.
    pub normal: Vec<[f32; 3]>,
    /// What is there.
    pub material: Vec<Material>,
}

impl Buffer {
    /// An empty picture of `size` x `size` samples.
    pub fn new(size: usize) -> Self {
        let n = size * size;
        Buffer {
            size,
            depth: vec![f32::INFINITY; n],
            normal: vec![[0.0; 3]; n],
            material: vec![Material::Background; n],
        }
    }

    /// Draws a ball.
    pub fn ball(&mut self, camera: &Camera, centre: [f32; 3], radius: f32) {
        let v = camera.view(centre);
        let [cx, cy] = camera.screen(v);
        let reach = radius * camera.scale_at(v[2]);
        let (columns, rows) = (self.span(cx - reach, cx + reach), self.span(cy - reach, cy + reach));
        for row in rows {
            for column in columns.clone() {
                let x = (column as f32 + 0.5 - cx) / reach;
                let y = (cy - row as f32 - 0.5) / reach;
                let rest = 1.0 - x * x - y * y;
                if rest > 0.0 {
                    let z = rest.sqrt();
                    self.put(row, column, v[2] - radius * z, [x, y, z], Material::Ball);
                }
            }
        }
    }

    /// Draws a triangle of three corners, each with position and normal, with the normals blended in between.
    pub fn triangle(&mut self, camera: &Camera, corners: [([f32; 3], [f32; 3]); 3]) {
        let seen = corners.map(|(p, _)| camera.view(p));
        let normals = corners.map(|(_, n)| camera.direction(n));
        let at = seen.map(|v| camera.screen(v));
        // Rows grow downwards, so what runs counter-clockwise for the viewer has a negative area here.
        let area = edge(at[0], at[1], at[2]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let (facing, material) = if area < 0.0 { (1.0, Material::Front) } else { (-1.0, Material::Back) };
        let range = |axis: usize| {
            let [a, b, c] = at.map(|p| p[axis]);
            (a.min(b).min(c), a.max(b).max(c))
        };
        let ((left, right), (top, bottom)) = (range(0), range(1));
        let (columns, rows) = (self.span(left, right), self.span(top, bottom));
        for row in rows {
            for column in columns.clone() {
                let p = [column as f32 + 0.5, row as f32 + 0.5];
                let weights = [edge(at[1], at[2], p), edge(at[2], at[0], p), edge(at[0], at[1], p)];
                let weights = weights.map(|w| w / area);
                if weights.iter().any(|&w| w < 0.0) {
                    continue;
                }
                // 1 / depth is linear on the screen.
                let near: [f32; 3] = std::array::from_fn(|i| weights[i] / seen[i][2]);
                let depth = 1.0 / (near[0] + near[1] + near[2]);
                let sum: [f32; 3] =
                    std::array::from_fn(|a| facing * (0..3).map(|i| near[i] * normals[i][a]).sum::<f32>());
                let len = sum.iter().map(|x| x * x).sum::<f32>().sqrt();
                let normal = if len > 0.0 { sum.map(|x| x / len) } else { [0.0, 0.0, 1.0] };
                self.put(row, column, depth, normal, material);
            }
        }
    }

    fn put(&mut self, row: usize, column: usize, depth: f32, normal: [f32; 3], material: Material) {
        let i = row * self.size + column;
        if depth < self.depth[i] {
            self.depth[i] = depth;
            self.normal[i] = normal;
            self.material[i] = material;
        }
    }

    /// The samples whose middles may lie between two places.
    fn span(&self, low: f32, high: f32) -> std::ops::Range<usize> {
        let end = self.size as f32;
        (low - 0.5).floor().clamp(0.0, end) as usize..(high + 0.5).ceil().clamp(0.0, end) as usize
    }
}

/// Twice the signed area of a triangle on the screen.
fn edge(a: [f32; 2], b: [f32; 2], p: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
}

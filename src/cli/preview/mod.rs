//! Pictures of a cloud and its reconstruction, side by side, by a small software renderer.
//!
//! Pictures are output and no result, so their arithmetic is here and not in the library.

use std::path::Path;

use bijective_sdf::geometry::{Normalizer, Position, TriangleMesh};

mod camera;
mod font;
mod image;
mod raster;
mod shade;
mod view;

use super::failure::Failure;
use super::info::nearest_distances;
use super::paths::is_pipe;
use camera::Camera;
pub use image::Image;
use raster::Buffer;
pub use view::{Angles, Axis, View, ViewArgs};

/// Width and height of each of the two panels, in pixels.
const PANEL: usize = 640;
/// Samples a pixel along each axis.
const SUPER: usize = 3;

/// Refuses a name that says another format than the one that pictures are written in.
pub fn check_picture(path: &Path) -> Result<(), Failure> {
    match path.extension().and_then(|e| e.to_str()) {
        _ if is_pipe(path) => Ok(()),
        Some(e) if e.eq_ignore_ascii_case("png") => Ok(()),
        _ => Err(Failure::Usage(format!("--preview {}: pictures are written as png only", path.display()))),
    }
}

/// Draws the points to the left and the mesh to the right, from the same place.
pub fn render(points: &[[f64; 3]], mesh: &TriangleMesh<[f64; 3]>, view: &View) -> Result<Image, Failure> {
    draw(points, mesh, view, PANEL)
}

fn draw(
    points: &[[f64; 3]],
    mesh: &TriangleMesh<[f64; 3]>,
    view: &View,
    panel: usize,
) -> Result<Image, Failure> {
    let mut all = points.to_vec();
    all.extend_from_slice(&mesh.verts);
    let scene = Scene::around(&all, view, panel)?;
    let mut image = Image::plain(2 * panel, panel, [255; 3]);
    image.paste(&scene.points(points), 0, 0);
    image.paste(&scene.mesh(mesh), panel, 0);
    Ok(image)
}

/// A place to look from, for pictures that can be compared.
pub struct Scene {
    /// In the unit frame, where sizes of balls and shadows mean the same for every input.
    frame: Normalizer,
    camera: Camera,
    panel: usize,
}

impl Scene {
    /// The place that shows all of `extent` (n x 3) in square pictures of `panel` pixels.
    pub fn around<P: Position>(extent: &[P], view: &View, panel: usize) -> Result<Self, Failure> {
        let frame = Normalizer::of(extent)?;
        let camera = Camera::around(&frame.forward(extent), view, panel * SUPER);
        Ok(Scene { frame, camera, panel })
    }

    /// A picture of points.
    pub fn points<P: Position>(&self, points: &[P]) -> Image {
        let points = self.frame.forward(points);
        let radius = nearest_distances(&points)
            .map_or(0.01, |[_, middle, _]| (0.3 * middle).clamp(0.0025, 0.0105)) as f32;
        let mut buffer = Buffer::new(self.panel * SUPER);
        for p in points.into_iter().filter(seen) {
            buffer.ball(&self.camera, p, radius);
        }
        self.resolve(&buffer)
    }

    /// A picture of a mesh.
    pub fn mesh(&self, mesh: &TriangleMesh<[f64; 3]>) -> Image {
        let verts = self.frame.forward(&mesh.verts);
        let normals = mesh.relative_to(mesh.offset()).vertex_normals();
        let mut buffer = Buffer::new(self.panel * SUPER);
        for &face in &mesh.faces {
            let corner = |i: usize| (verts[face[i] as usize], normals[face[i] as usize]);
            let corners = [corner(0), corner(1), corner(2)];
            if corners.iter().all(|(p, _)| seen(p)) {
                buffer.triangle(&self.camera, corners);
            }
        }
        self.resolve(&buffer)
    }

    fn resolve(&self, buffer: &Buffer) -> Image {
        Image::new(self.panel, self.panel, shade::resolve(buffer, &self.camera, SUPER))
    }
}

/// Whether a place in the unit frame is surely in front of the camera.
fn seen(p: &[f32; 3]) -> bool {
    p.iter().all(|x| x.abs() < 1.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bijective_sdf::geometry::{AnalyticShape, NarrowBandOptions, TetGrid, extract_mesh, widened};

    /// A smaller panel, for speed.
    const PANEL: usize = 120;

    fn scene() -> (Vec<[f64; 3]>, TriangleMesh<[f64; 3]>) {
        let shape = AnalyticShape::Sphere { radius: 0.5 };
        let grid = TetGrid::covering([-0.6; 3], [0.6; 3], 24, 1).unwrap();
        let mut sdf = |p: &[[f32; 3]]| Ok(p.iter().map(|&p| shape.sdf(p)).collect());
        let mesh = extract_mesh(&grid, &mut sdf, &NarrowBandOptions::default()).unwrap();
        (widened(&shape.sample(200, 1).0), mesh.wide())
    }

    fn pixel(image: &Image, x: usize, y: usize) -> [u8; 3] {
        let at = 3 * (y * image.width() + x);
        image.rgb()[at..at + 3].try_into().unwrap()
    }

    #[test]
    fn a_sphere_fills_its_panel_and_shows_its_outside() {
        let (points, mut mesh) = scene();
        let image = draw(&points, &mesh, &View::default(), PANEL).unwrap();
        let [r, _, b] = pixel(&image, PANEL + PANEL / 2, PANEL / 2);
        assert!(b > r, "the front is blue");
        let [r, g, b] = pixel(&image, PANEL + 2, 2);
        assert!(r > 225 && g > 225 && b > 225, "the corner is background");
        mesh.faces.iter_mut().for_each(|f| f.swap(0, 1));
        let inside_out = draw(&points, &mesh, &View::default(), PANEL).unwrap();
        let [r, _, b] = pixel(&inside_out, PANEL + PANEL / 2, PANEL / 2);
        assert!(r > b, "the back is red");
        assert_eq!(image.rgb()[..3 * PANEL], inside_out.rgb()[..3 * PANEL]);
        let drawn = |from: usize| {
            (0..PANEL * PANEL).filter(|i| pixel(&image, from + i % PANEL, i / PANEL)[0] < 220).count() as f64
        };
        let share = drawn(PANEL) / (PANEL * PANEL) as f64;
        assert!((0.5..0.75).contains(&share), "{share} of the panel");
        assert!(drawn(0) > 400.0);
    }

    #[test]
    fn pictures_are_png_and_do_not_depend_on_place_and_size() {
        let (points, mesh) = scene();
        let image = draw(&points, &mesh, &View::default(), PANEL).unwrap();
        let far = |p: &[f64; 3]| p.map(|x| 8.0 * x + 5e6);
        let moved = TriangleMesh { verts: mesh.verts.iter().map(far).collect(), faces: mesh.faces };
        let points: Vec<_> = points.iter().map(far).collect();
        let other = draw(&points, &moved, &View::default(), PANEL).unwrap();
        let apart = image.rgb().iter().zip(other.rgb()).filter(|(a, b)| a.abs_diff(**b) > 8).count();
        assert!(apart < image.rgb().len() / 200, "{apart}");
        let png = image.to_png();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut back = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut back).unwrap();
        assert_eq!((info.width, info.height), (2 * PANEL as u32, PANEL as u32));
        assert_eq!(back, image.rgb());
    }
}

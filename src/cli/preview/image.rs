//! Pictures as pixels: put together, written on, and saved.

use super::font;

/// A picture: rows from the top, red, green, blue.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Image {
    /// A picture of the given pixels.
    pub fn new(width: usize, height: usize, rgb: Vec<u8>) -> Self {
        assert!(rgb.len() == 3 * width * height, "Image: {} bytes for {width} x {height}", rgb.len());
        Image { width, height, rgb }
    }

    /// A picture of one colour.
    pub fn plain(width: usize, height: usize, colour: [u8; 3]) -> Self {
        Image { width, height, rgb: colour.repeat(width * height) }
    }

    /// Pixels in a row.
    #[cfg(test)]
    pub fn width(&self) -> usize {
        self.width
    }

    /// The bytes, row by row.
    #[cfg(test)]
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// Puts a picture with its top left corner at a place; what lies outside is cut off.
    pub fn paste(&mut self, part: &Image, x: usize, y: usize) {
        let columns = part.width.min(self.width.saturating_sub(x));
        for row in 0..part.height.min(self.height.saturating_sub(y)) {
            let to = 3 * ((y + row) * self.width + x);
            let from = 3 * row * part.width;
            self.rgb[to..to + 3 * columns].copy_from_slice(&part.rgb[from..from + 3 * columns]);
        }
    }

    /// Fills a rectangle; what lies outside is cut off.
    pub fn fill(&mut self, [x, y]: [usize; 2], [width, height]: [usize; 2], colour: [u8; 3]) {
        let right = (x + width).min(self.width);
        for row in y..(y + height).min(self.height) {
            for pixel in self.rgb[3 * row * self.width..][3 * x.min(right)..3 * right].chunks_exact_mut(3) {
                pixel.copy_from_slice(&colour);
            }
        }
    }

    /// Draws the border of a rectangle, `line` pixels thick, inside it.
    pub fn frame(&mut self, [x, y]: [usize; 2], [width, height]: [usize; 2], line: usize, colour: [u8; 3]) {
        self.fill([x, y], [width, line], colour);
        self.fill([x, y + height - line], [width, line], colour);
        self.fill([x, y], [line, height], colour);
        self.fill([x + width - line, y], [line, height], colour);
    }

    /// Writes a line of text with its top left corner at a place, each dot of a letter `scale` pixels wide.
    pub fn text(&mut self, text: &str, [x, y]: [usize; 2], scale: usize, colour: [u8; 3]) {
        for (i, c) in text.chars().enumerate() {
            let left = x + i * font::ADVANCE * scale;
            for (row, bits) in font::glyph(c).into_iter().enumerate() {
                for column in (0..font::WIDTH).filter(|column| bits >> (font::WIDTH - 1 - column) & 1 == 1) {
                    self.fill([left + column * scale, y + (font::drop(c) + row) * scale], [scale; 2], colour);
                }
            }
        }
    }

    /// The bytes of a PNG file.
    pub fn to_png(&self) -> Vec<u8> {
        self.compressed(png::Compression::Balanced)
    }

    /// The bytes of a PNG file, as small as it gets; takes seconds for a large picture.
    pub fn to_small_png(&self) -> Vec<u8> {
        self.compressed(png::Compression::High)
    }

    fn compressed(&self, compression: png::Compression) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(compression);
        let written = encoder.write_header().and_then(|mut w| w.write_image_data(&self.rgb));
        written.expect("writing to memory a picture of its own size");
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels that are not white, as text.
    fn dots(image: &Image) -> Vec<String> {
        image
            .rgb
            .chunks_exact(3 * image.width)
            .map(|row| row.chunks_exact(3).map(|p| if p == [255; 3] { '.' } else { '#' }).collect())
            .collect()
    }

    #[test]
    fn parts_are_cut_off_at_the_border() {
        let mut image = Image::plain(5, 4, [255; 3]);
        image.paste(&Image::plain(3, 3, [0; 3]), 3, 2);
        image.paste(&Image::plain(3, 3, [0; 3]), 9, 9);
        image.fill([0, 0], [1, 9], [1; 3]);
        image.fill([7, 1], [2, 2], [1; 3]);
        assert_eq!(dots(&image), ["#....", "#....", "#..##", "#..##"]);
        let mut image = Image::plain(5, 4, [255; 3]);
        image.frame([0, 0], [5, 4], 1, [9, 0, 0]);
        assert_eq!(dots(&image), ["#####", "#...#", "#...#", "#####"]);
    }

    #[test]
    fn letters_stand_side_by_side() {
        let mut image = Image::plain(13, 8, [255; 3]);
        image.text("T7!", [1, 1], 1, [0; 3]);
        let want = [
            ".............",
            ".#####.#####.",
            "...#.......#.",
            "...#......#..",
            "...#.....#...",
            "...#....#....",
            "...#....#....",
            "...#....#....",
        ];
        assert_eq!(dots(&image), want);
    }

    #[test]
    fn both_compressions_hold_the_same_picture() {
        let mut image = Image::plain(40, 30, [250, 240, 230]);
        image.text("abc", [2, 2], 2, [10, 20, 30]);
        let read = |bytes: Vec<u8>| {
            let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
            let mut back = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut back).unwrap();
            Image::new(info.width as usize, info.height as usize, back)
        };
        assert_eq!(read(image.to_png()), image);
        assert_eq!(read(image.to_small_png()), image);
    }
}

//! A small bitmap font: the letters and digits that legends need, 5 by 9 pixels.

/// Width of a letter without the gap, pixels.
const WIDTH: u32 = 5;
/// Height of a line with room below for the next, pixels.
pub(super) const HEIGHT: u32 = 10;
/// From one letter to the next, pixels.
const ADVANCE: u32 = 6;

/// Rows from the top, `#` is ink; the last two rows hang below the line.
const GLYPHS: &[(char, [&str; 9])] = &[
    ('0', [".###.", "#...#", "#..##", "#.#.#", "##..#", "#...#", ".###.", "", ""]),
    ('1', ["..#..", ".##..", "..#..", "..#..", "..#..", "..#..", ".###.", "", ""]),
    ('2', [".###.", "#...#", "....#", "..##.", ".#...", "#....", "#####", "", ""]),
    ('3', [".###.", "#...#", "....#", "..##.", "....#", "#...#", ".###.", "", ""]),
    ('4', ["...#.", "..##.", ".#.#.", "#..#.", "#####", "...#.", "...#.", "", ""]),
    ('5', ["#####", "#....", "####.", "....#", "....#", "#...#", ".###.", "", ""]),
    ('6', [".###.", "#....", "#....", "####.", "#...#", "#...#", ".###.", "", ""]),
    ('7', ["#####", "....#", "...#.", "...#.", "..#..", "..#..", "..#..", "", ""]),
    ('8', [".###.", "#...#", "#...#", ".###.", "#...#", "#...#", ".###.", "", ""]),
    ('9', [".###.", "#...#", "#...#", ".####", "....#", "....#", ".###.", "", ""]),
    ('.', ["", "", "", "", "", ".##..", ".##..", "", ""]),
    ('-', ["", "", "", ".###.", "", "", "", "", ""]),
    ('a', ["", "", ".###.", "....#", ".####", "#...#", ".####", "", ""]),
    ('c', ["", "", ".###.", "#....", "#....", "#...#", ".###.", "", ""]),
    ('d', ["....#", "....#", ".####", "#...#", "#...#", "#...#", ".####", "", ""]),
    ('e', ["", "", ".###.", "#...#", "#####", "#....", ".###.", "", ""]),
    ('f', ["..##.", ".#...", "####.", ".#...", ".#...", ".#...", ".#...", "", ""]),
    ('i', ["..#..", "", ".##..", "..#..", "..#..", "..#..", ".###.", "", ""]),
    ('l', [".##..", "..#..", "..#..", "..#..", "..#..", "..#..", ".###.", "", ""]),
    ('m', ["", "", "##.#.", "#.#.#", "#.#.#", "#.#.#", "#.#.#", "", ""]),
    ('n', ["", "", "####.", "#...#", "#...#", "#...#", "#...#", "", ""]),
    ('o', ["", "", ".###.", "#...#", "#...#", "#...#", ".###.", "", ""]),
    ('p', ["", "", "####.", "#...#", "#...#", "#...#", "####.", "#....", "#...."]),
    ('r', ["", "", "#.##.", "##...", "#....", "#....", "#....", "", ""]),
    ('s', ["", "", ".####", "#....", ".###.", "....#", "####.", "", ""]),
    ('t', [".#...", ".#...", "####.", ".#...", ".#...", ".#..#", "..##.", "", ""]),
    ('u', ["", "", "#...#", "#...#", "#...#", "#...#", ".####", "", ""]),
    ('x', ["", "", "#...#", ".#.#.", "..#..", ".#.#.", "#...#", "", ""]),
];

/// Width of a text, pixels.
pub(super) fn width(text: &str) -> u32 {
    (text.chars().count() as u32 * ADVANCE).saturating_sub(ADVANCE - WIDTH)
}

/// Call `ink` for every pixel of a text, from its top-left corner. A letter without a glyph is a gap.
pub(super) fn draw(text: &str, mut ink: impl FnMut(u32, u32)) {
    for (i, letter) in text.chars().enumerate() {
        let Some((_, rows)) = GLYPHS.iter().find(|(known, _)| *known == letter) else { continue };
        for (y, row) in rows.iter().enumerate() {
            for (x, _) in row.bytes().enumerate().filter(|(_, pixel)| *pixel == b'#') {
                ink(i as u32 * ADVANCE + x as u32, y as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_glyph_fits_its_cell_and_differs_from_the_others() {
        for (i, (letter, rows)) in GLYPHS.iter().enumerate() {
            assert!(rows.iter().all(|row| row.is_empty() || row.len() == WIDTH as usize), "{letter}");
            assert!(rows.iter().any(|row| row.contains('#')), "{letter}");
            assert!(GLYPHS[..i].iter().all(|(other, drawn)| other != letter && drawn != rows), "{letter}");
        }
    }
}

//! The AprilTag of the target: number 0 of the family tag36h11.

/// Cells along a side of the black border; the code is the 6 x 6 in its middle.
pub const CELLS_PER_SIDE: usize = 8;

/// Code number 0 of the family tag36h11, row by row from the top left, the highest bit first, 1 is
/// white. From the family's table in the AprilTag sources (PyPI package `apriltag` 0.0.16,
/// `core/tag36h11.c`); a rendered frame is found as number 0 by PyPI's `pupil-apriltags`.
const TAG36H11_0: u64 = 0xd_5d62_8584;

/// Whether the tag is white at this place: 0..1 from its left and its top edge.
pub fn is_white(right: f64, down: f64) -> bool {
    let cell = |part: f64| (part * CELLS_PER_SIDE as f64).floor() as isize;
    let (column, row) = (cell(right), cell(down));
    let inner = 1..CELLS_PER_SIDE as isize - 1;
    if !inner.contains(&column) || !inner.contains(&row) {
        return false;
    }
    let bit = 35 - ((row - 1) * 6 + column - 1);
    TAG36H11_0 >> bit & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_border_is_black_and_the_code_has_its_bits() {
        let centre = |i: usize| (i as f64 + 0.5) / CELLS_PER_SIDE as f64;
        let white = |x: usize, y: usize| is_white(centre(x), centre(y));
        assert!(
            (0..CELLS_PER_SIDE)
                .all(|i| !white(i, 0) && !white(0, i) && !white(i, 7) && !white(7, i))
        );
        let n_white = (0..64).filter(|i| white(i % 8, i / 8)).count();
        assert_eq!(n_white, 0xd_5d62_8584_u64.count_ones() as usize);
        // 0xd is 1101: the first row of the code begins white, white, black, white.
        assert_eq!([1, 2, 3, 4].map(|x| white(x, 1)), [true, true, false, true]);
    }
}

//! How the print lies to the head, by the tag's perspective.
//!
//! Held against a map that was made from the same frames, a tilt of the print hardly shows: the map
//! tilts along, a distance that changes with the place makes up for most of what is left, and a late
//! row for the rest. The tag's own shape knows nothing of the map. Beside the optical axis a tilt makes
//! it narrower: a hundredth of a pixel is a milliradian, and over a track those errors that follow from
//! how the corners fall on the pixels come out of the mean. A lens that is not what the rig states
//! looks like a tilt here.

use super::head::{HEAD, Head};
use super::robust::clustered;
use super::start::{Corners, TagPath, TagSquare};
use nalgebra::{SMatrix, SVector};

/// Instants of the track that are looked at.
const LOOKS: usize = 240;

/// Fewer say nothing.
const LEAST: usize = 12;

/// Rounds of Gauss and Newton; the second one is already nearly exact.
const ROUNDS: usize = 6;

/// Standard deviation of the tilts of print and wrist's axis before anything is seen, radians.
const TILT_RAD: f64 = 0.02;

/// What the tag's perspective is wrong by as such, radians: a lens not quite as stated, corners that err
/// alike at all places.
const FLOOR_RAD: f64 = 1e-3;

/// Step by which the head is moved to get slopes.
const HEAD_STEP: f64 = 1e-5;

/// The head's constants as the tag shows them, and how well.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lie {
    pub(super) head: Head,
    /// Inverse of the covariance of its tilts, in the order of [`Head::moved`].
    pub(super) information: SMatrix<f64, HEAD, HEAD>,
}

/// Equations for the head's constants, the poses taken out.
struct Sums {
    normal: SMatrix<f64, HEAD, HEAD>,
    right: SVector<f64, HEAD>,
    /// The right side, look by look.
    scores: Vec<SVector<f64, HEAD>>,
    squares: f64,
}

impl Lie {
    /// As the tag of this path shows it.
    pub(super) fn by(tag: &TagPath<'_>) -> Self {
        Self::of(tag.square(), tag.head, &tag.looks(LOOKS))
    }

    /// As looks at the tag show it, for a head that is stated to lie so.
    fn of(square: TagSquare, stated: Head, looks: &[Corners]) -> Self {
        let before = SMatrix::<f64, HEAD, HEAD>::identity() * TILT_RAD.powi(-2);
        let unknown = Self { head: stated, information: before };
        let mut lie = unknown;
        for round in 0..ROUNDS {
            let sums = Sums::over(square, &lie.head, looks);
            let n = sums.scores.len();
            if n < LEAST {
                return unknown;
            }
            let variance = (sums.squares / (4 * n - HEAD) as f64).max(f64::MIN_POSITIVE);
            let (normal, right) = (sums.normal / variance, sums.right / variance);
            let Some(inverse) = (normal + before).try_inverse() else { return unknown };
            let change = inverse * (right - before * apart(&lie.head, &stated));
            lie.head = lie.head.moved(&change.into());
            if round + 1 == ROUNDS {
                lie.information = information(&normal, &inverse, &sums.scores, variance, &before);
            }
        }
        let is_sound = lie.information.iter().all(|part| part.is_finite());
        if is_sound { lie } else { unknown }
    }
}

/// The tilts of a head beyond those of another.
pub(super) fn apart(head: &Head, other: &Head) -> SVector<f64, HEAD> {
    SVector::from([
        head.tilt_rad[0] - other.tilt_rad[0],
        head.tilt_rad[1] - other.tilt_rad[1],
        head.axis_tilt_rad[0] - other.axis_tilt_rad[0],
        head.axis_tilt_rad[1] - other.axis_tilt_rad[1],
    ])
}

/// What is known in the end: less than the equations say by as much as neighbouring looks err
/// together, and never better than [`FLOOR_RAD`].
fn information(
    normal: &SMatrix<f64, HEAD, HEAD>,
    inverse: &SMatrix<f64, HEAD, HEAD>,
    scores: &[SVector<f64, HEAD>],
    variance: f64,
    before: &SMatrix<f64, HEAD, HEAD>,
) -> SMatrix<f64, HEAD, HEAD> {
    let scores: Vec<_> = scores.iter().map(|score| score / variance).collect();
    let together = clustered(inverse, &scores);
    let factor = (0..HEAD).map(|i| together[(i, i)] / inverse[(i, i)]).fold(1.0, f64::max);
    let floor = SMatrix::<f64, HEAD, HEAD>::identity() * FLOOR_RAD.powi(2);
    let covariance = (normal / factor + before).try_inverse().map(|own| own + floor);
    covariance.and_then(|covariance| covariance.try_inverse()).unwrap_or(*before)
}

impl Sums {
    fn over(square: TagSquare, head: &Head, looks: &[Corners]) -> Self {
        let (normal, right) = (SMatrix::zeros(), SVector::zeros());
        let mut sums = Self { normal, right, scores: Vec::new(), squares: 0.0 };
        for look in looks {
            // A look that no pose of the head can have is left out.
            let _ = sums.add(square, head, look);
        }
        sums
    }

    fn add(&mut self, square: TagSquare, head: &Head, look: &Corners) -> Option<()> {
        let pose = square.pose(head, look)?;
        let here = square.rays(head, &pose);
        let left = SVector::<f64, 8>::from_fn(|i, _| look[i / 2][i % 2]) - here;
        let mut shared = SMatrix::<f64, 8, HEAD>::zeros();
        for i in 0..HEAD {
            let mut by = [0.0; HEAD];
            by[i] = HEAD_STEP;
            shared.set_column(i, &((square.rays(&head.moved(&by), &pose) - here) / HEAD_STEP));
        }
        // What the pose can make up for says nothing of the head.
        let own = square.by_pose(head, &pose);
        let onto_pose = (own.transpose() * own).try_inverse()? * own.transpose();
        let left = left - own * (onto_pose * left);
        let shared = shared - own * (onto_pose * shared);
        let score = shared.transpose() * left;
        self.normal += shared.transpose() * shared;
        self.right += score;
        self.scores.push(score);
        self.squares += left.norm_squared();
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: Corners = [[-7.0, 7.0], [7.0, 7.0], [7.0, -7.0], [-7.0, -7.0]];

    fn head(tilt_rad: [f64; 2], axis_tilt_rad: [f64; 2]) -> Head {
        Head { roll_rad: 0.3, tilt_rad, axis: [0.0, 0.0, 1.0], axis_tilt_rad }
    }

    /// Looks from a circle on which the wrist swings by `turn` radians, each coordinate off by up to
    /// `wrong` one way or the other.
    fn looks(truth: &Head, turn: f64, wrong: f64) -> Vec<Corners> {
        let square = TagSquare(CORNERS);
        (0..200_u32)
            .map(|k| {
                let phase = 0.1 * f64::from(k);
                let place = [12.0 * phase.cos(), 12.0 * phase.sin()];
                let pose = [place[0], place[1], 225.0, turn * (0.7 * phase).sin()];
                let rays = square.rays(truth, &pose);
                std::array::from_fn(|i| {
                    [0, 1].map(|axis| {
                        let mixed = (8 * k + (2 * i + axis) as u32).wrapping_mul(2_654_435_761);
                        rays[2 * i + axis] + wrong * (f64::from(mixed >> 16) / 32_768.0 - 1.0)
                    })
                })
            })
            .collect()
    }

    #[test]
    fn a_planted_tilt_of_the_print_comes_back_within_its_error() {
        let truth = head([0.015, -0.008], [0.0; 2]);
        // Two hundredths of a pixel of 1700 to the radian.
        let found =
            Lie::of(TagSquare(CORNERS), head([0.0; 2], [0.0; 2]), &looks(&truth, 0.0, 1.2e-5));
        let covariance = found.information.try_inverse().unwrap();
        for i in 0..2 {
            let (off, error) =
                (found.head.tilt_rad[i] - truth.tilt_rad[i], covariance[(i, i)].sqrt());
            assert!(off.abs() < 3.0 * error && error < 2e-3, "{off} {error}");
            // A wrist that does not turn says nothing of its axis.
            assert!(covariance[(2 + i, 2 + i)].sqrt() > 0.9 * TILT_RAD);
        }
    }

    #[test]
    fn a_wrist_that_swings_shows_its_axis_too() {
        let truth = head([0.004, 0.011], [-0.006, 0.009]);
        let found =
            Lie::of(TagSquare(CORNERS), head([0.0; 2], [0.0; 2]), &looks(&truth, 0.3, 1e-7));
        for i in 0..2 {
            assert!((found.head.tilt_rad[i] - truth.tilt_rad[i]).abs() < 1e-3, "{found:?}");
            assert!(
                (found.head.axis_tilt_rad[i] - truth.axis_tilt_rad[i]).abs() < 3e-3,
                "{found:?}"
            );
        }
    }

    #[test]
    fn too_few_looks_leave_what_is_stated() {
        let truth = head([0.015, -0.008], [0.0; 2]);
        let few = &looks(&truth, 0.0, 0.0)[..LEAST - 1];
        let found = Lie::of(TagSquare(CORNERS), head([0.0; 2], [0.0; 2]), few);
        assert_eq!(found.head.tilt_rad, [0.0; 2]);
    }
}

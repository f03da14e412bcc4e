//! Range and distinct values of a column.

/// Values that are compared without a branch on each: polarities are as random as a coin.
const VALUES_PER_BLOCK: usize = 1 << 10;

/// Smallest and largest; none of no values.
pub(super) fn bounds<T: Copy + PartialOrd>(values: &[T]) -> Option<[T; 2]> {
    let first = *values.first()?;
    let widen = |[min, max]: [T; 2], &value: &T| {
        [if value < min { value } else { min }, if value > max { value } else { max }]
    };
    Some(values.iter().fold([first; 2], widen))
}

/// The first distinct values, at most `N`.
pub(super) fn first_distinct<T: Copy + PartialEq, const N: usize>(values: &[T]) -> Vec<T> {
    let Some(&first) = values.first() else { return Vec::new() };
    let mut known = [first; N];
    let mut n = 1;
    for block in values.chunks(VALUES_PER_BLOCK) {
        let is_new = |known: [T; N], value: T| known.iter().fold(true, |is, k| is & (*k != value));
        if !block.iter().fold(false, |is, value| is | is_new(known, *value)) {
            continue;
        }
        for value in block {
            if n < N && is_new(known, *value) {
                known[n] = *value;
                n += 1;
            }
        }
        if n == N {
            break;
        }
    }
    known[..n].to_vec()
}

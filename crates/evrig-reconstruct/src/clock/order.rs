//! Longest increasing sequence of stamps.

/// Marks the members of a longest strictly increasing subsequence, in O(n log n) (patience sorting;
/// Fredman, Discrete Mathematics 11, 1975).
///
/// A single wrong stamp costs one frame, whether it is early or late.
pub(super) fn longest_increasing(values: &[i64]) -> Vec<bool> {
    // tails[l]: index of the smallest value that ends an increasing run of length l + 1.
    let mut tails: Vec<usize> = Vec::new();
    let mut before: Vec<Option<usize>> = vec![None; values.len()];
    for (index, value) in values.iter().enumerate() {
        let length = tails.partition_point(|&tail| values[tail] < *value);
        before[index] = length.checked_sub(1).map(|shorter| tails[shorter]);
        match tails.get_mut(length) {
            Some(tail) => *tail = index,
            None => tails.push(index),
        }
    }
    let mut is_member = vec![false; values.len()];
    let mut at = tails.last().copied();
    while let Some(index) = at {
        is_member[index] = true;
        at = before[index];
    }
    is_member
}

#[cfg(test)]
mod tests {
    use super::longest_increasing;

    #[test]
    fn a_wild_stamp_ahead_or_behind_costs_only_itself() {
        let kept = longest_increasing(&[1, 2, 900, 3, 4, -7, 5]);
        assert_eq!(kept, [true, true, false, true, true, false, true]);
    }

    #[test]
    fn equal_stamps_are_kept_once() {
        let kept = longest_increasing(&[1, 1, 2, 2, 3]);
        assert_eq!(kept.iter().filter(|&&k| k).count(), 3);
        assert!(longest_increasing(&[]).is_empty());
    }
}

//! From the pixels' requests to stamped events: arbiter, bus, filter, losses, stamps.

use super::pixel::EventRequest;
use crate::world::draws::{RandomPurpose, WorldRandom};
use crate::world::effects::{EventDrop, WorldEffects};
use std::collections::{BTreeSet, VecDeque};

/// A stamp's error is cut off at so many standard deviations, so that later events can be waited
/// for.
const MAX_SIGMAS: f32 = 5.0;

/// The chain behind the pixels. Requests go in in order, slab by slab; events come out in order.
#[derive(Debug)]
pub(super) struct DavisReadout {
    arbiter: Arbiter,
    support: Option<SupportFilterState>,
    drop: Option<EventDrop>,
    jitter_ns: f64,
    seed: u64,
    n_seen: u64,
    /// Requests that a pixel's latency carries beyond their slab.
    late: Vec<EventRequest>,
    /// Stamped events that an earlier one may still overtake.
    stamped: Vec<EventRequest>,
}

/// Who is served when.
#[derive(Debug)]
enum Arbiter {
    /// At once.
    Ideal,
    /// One request after another.
    Queue { service_ns: f64, free_at_ns: f64 },
    /// A row after another, the row of the oldest request first.
    Rows(RowArbiter),
}

#[derive(Debug)]
struct RowArbiter {
    width: usize,
    row_ns: f64,
    service_ns: f64,
    free_at_ns: f64,
    waiting: Vec<VecDeque<EventRequest>>,
    /// Oldest request of each row that has one.
    fronts: BTreeSet<(i64, usize)>,
}

/// Passes an event only when a neighbour fired shortly before.
#[derive(Debug)]
struct SupportFilterState {
    window_ns: i64,
    width: usize,
    last_ns: Vec<i64>,
}

impl DavisReadout {
    pub(super) fn new(effects: &WorldEffects, [width, height]: [usize; 2], seed: u64) -> Self {
        let service_ns = effects.readout_saturation.map(|bus| 1e9 / bus.max_events_per_s);
        let arbiter = match (effects.row_readout, service_ns) {
            (Some(rows), service) => Arbiter::Rows(RowArbiter {
                width,
                row_ns: rows.row_us * 1e3,
                service_ns: service.unwrap_or(0.0),
                free_at_ns: f64::NEG_INFINITY,
                waiting: vec![VecDeque::new(); height],
                fronts: BTreeSet::new(),
            }),
            (None, Some(service_ns)) => {
                Arbiter::Queue { service_ns, free_at_ns: f64::NEG_INFINITY }
            }
            (None, None) => Arbiter::Ideal,
        };
        Self {
            arbiter,
            support: effects.support_filter.map(|filter| SupportFilterState {
                window_ns: (filter.window_us * 1e3) as i64,
                width,
                last_ns: vec![i64::MIN / 2; width * height],
            }),
            drop: effects.event_drop.filter(|drop| drop.fraction > 0.0),
            jitter_ns: effects.stamp_jitter.map_or(0.0, |jitter| jitter.sigma_us * 1e3),
            seed,
            n_seen: 0,
            late: Vec::new(),
            stamped: Vec::new(),
        }
    }

    /// Takes a slab's requests (any order) and gives the events whose stamps are final.
    pub(super) fn run(
        &mut self,
        mut requests: Vec<EventRequest>,
        slab_end_ns: i64,
    ) -> Vec<EventRequest> {
        requests.append(&mut self.late);
        requests.sort_unstable();
        let n_now = requests.partition_point(|request| request.at_ns < slab_end_ns);
        self.late.extend_from_slice(&requests[n_now..]);
        requests.truncate(n_now);
        let mut served = Vec::with_capacity(requests.len());
        self.arbiter.serve(&requests, slab_end_ns, &mut served);
        for request in served {
            self.stamp(request);
        }
        let horizon = slab_end_ns - (f64::from(MAX_SIGMAS) * self.jitter_ns).ceil() as i64;
        self.stamped.sort_unstable();
        let n_final = self.stamped.partition_point(|event| event.at_ns < horizon);
        let rest = self.stamped.split_off(n_final);
        std::mem::replace(&mut self.stamped, rest)
    }

    fn stamp(&mut self, mut event: EventRequest) {
        let number = self.n_seen;
        self.n_seen += 1;
        if self.support.as_mut().is_some_and(|support| !support.passes(event)) {
            return;
        }
        if let Some(drop) = self.drop {
            let key = if drop.burst_us > 0.0 {
                (event.at_ns as f64 / (drop.burst_us * 1e3)).floor() as i64 as u64
            } else {
                number
            };
            if WorldRandom::new(self.seed, RandomPurpose::Drop, key, 0).uniform() < drop.fraction {
                return;
            }
        }
        if self.jitter_ns > 0.0 {
            let mut draws = WorldRandom::new(self.seed, RandomPurpose::Jitter, number, 0);
            let error = draws.normal().clamp(-MAX_SIGMAS, MAX_SIGMAS);
            event.at_ns += (f64::from(error) * self.jitter_ns).round() as i64;
        }
        self.stamped.push(event);
    }
}

impl Arbiter {
    fn serve(&mut self, requests: &[EventRequest], until_ns: i64, served: &mut Vec<EventRequest>) {
        match self {
            Self::Ideal => served.extend_from_slice(requests),
            Self::Queue { service_ns, free_at_ns } => {
                for request in requests {
                    let granted = free_at_ns.max(request.at_ns as f64);
                    *free_at_ns = granted + *service_ns;
                    served.push(EventRequest { at_ns: granted.round() as i64, ..*request });
                }
            }
            Self::Rows(rows) => {
                for request in requests {
                    rows.grant_until(request.at_ns, served);
                    rows.add(*request);
                }
                rows.grant_until(until_ns, served);
            }
        }
    }
}

impl RowArbiter {
    fn add(&mut self, request: EventRequest) {
        let row = request.pixel as usize / self.width;
        if self.waiting[row].is_empty() {
            self.fronts.insert((request.at_ns, row));
        }
        self.waiting[row].push_back(request);
    }

    /// Grants rows as long as that happens before `until_ns`; all that waits came before that.
    fn grant_until(&mut self, until_ns: i64, served: &mut Vec<EventRequest>) {
        while let Some((oldest, row)) = self.fronts.first().copied() {
            let granted = self.free_at_ns.max(oldest as f64);
            if granted >= until_ns as f64 {
                return;
            }
            self.fronts.remove(&(oldest, row));
            let at_ns = granted.round() as i64;
            let n = self.waiting[row].len();
            served.extend(self.waiting[row].drain(..).map(|event| EventRequest { at_ns, ..event }));
            self.free_at_ns = granted + self.row_ns.max(n as f64 * self.service_ns);
        }
    }
}

impl SupportFilterState {
    fn passes(&mut self, event: EventRequest) -> bool {
        let (pixel, height) = (event.pixel as usize, self.last_ns.len() / self.width);
        let (x, y) = (pixel % self.width, pixel / self.width);
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        let is_supported = (y.saturating_sub(1)..(y + 2).min(height)).any(|row| {
            columns.clone().any(|column| {
                let other = row * self.width + column;
                other != pixel && event.at_ns - self.last_ns[other] <= self.window_ns
            })
        });
        self.last_ns[pixel] = event.at_ns;
        is_supported
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effects::{ReadoutSaturation, RowReadout, StampJitter, SupportFilter};

    fn requests(times_ns: &[(i64, u32)]) -> Vec<EventRequest> {
        times_ns.iter().map(|&(at_ns, pixel)| EventRequest { at_ns, pixel, on: true }).collect()
    }

    fn stamps(effects: &WorldEffects, input: &[(i64, u32)]) -> Vec<(i64, u32)> {
        let mut readout = DavisReadout::new(effects, [10, 4], 1);
        let mut events = readout.run(requests(input), 1_000_000);
        events.extend(readout.run(Vec::new(), 2_000_000_000));
        events.iter().map(|event| (event.at_ns, event.pixel)).collect()
    }

    #[test]
    fn an_ideal_readout_changes_nothing() {
        let input = [(10, 3), (10, 4), (50, 1), (2_500_000, 2)];
        assert_eq!(stamps(&WorldEffects::default(), &input), input);
    }

    #[test]
    fn a_saturated_bus_delays_and_loses_nothing() {
        let bus = ReadoutSaturation { max_events_per_s: 1e7 };
        let effects = WorldEffects { readout_saturation: Some(bus), ..WorldEffects::default() };
        let input = [(0, 1), (0, 2), (0, 3), (1_000, 4)];
        assert_eq!(stamps(&effects, &input), [(0, 1), (100, 2), (200, 3), (1_000, 4)]);
    }

    #[test]
    fn a_row_that_waits_is_read_together() {
        let effects = WorldEffects {
            row_readout: Some(RowReadout { row_us: 1.0 }),
            ..WorldEffects::default()
        };
        let input = [(0, 5), (100, 15), (200, 16), (300, 6), (5_000, 1)];
        let expected = [(0, 5), (1_000, 15), (1_000, 16), (2_000, 6), (5_000, 1)];
        assert_eq!(stamps(&effects, &input), expected);
    }

    #[test]
    fn jitter_scatters_stamps_and_keeps_their_order() {
        let jitter = Some(StampJitter { sigma_us: 30.0 });
        let effects = WorldEffects { stamp_jitter: jitter, ..WorldEffects::default() };
        let input: Vec<(i64, u32)> = (0..4_000).map(|i| (i * 100_000, (i % 40) as u32)).collect();
        let got = stamps(&effects, &input);
        assert_eq!(got.len(), input.len());
        assert!(got.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        let near = |(t, pixel): &(i64, u32)| {
            let index = (0..4_000).filter(|i| (i % 40) as u32 == *pixel);
            let error = index.map(|i| (t - i * 100_000).abs()).min().unwrap() as f64;
            error * error
        };
        let rms = (got.iter().map(near).sum::<f64>() / got.len() as f64).sqrt();
        assert!((rms - 30_000.0).abs() < 1_500.0, "{rms}");
    }

    #[test]
    fn a_lonely_event_does_not_pass_the_support_filter() {
        let filter = Some(SupportFilter { window_us: 10.0 });
        let effects = WorldEffects { support_filter: filter, ..WorldEffects::default() };
        let input = [(0, 1), (5_000, 2), (50_000, 3), (60_000, 39)];
        assert_eq!(stamps(&effects, &input), [(5_000, 2)]);
    }

    #[test]
    fn lost_events_are_the_share_asked_for_one_by_one_or_in_bursts() {
        for burst_us in [0.0, 500.0] {
            let drop = Some(EventDrop { fraction: 0.2, burst_us });
            let effects = WorldEffects { event_drop: drop, ..WorldEffects::default() };
            let input: Vec<(i64, u32)> = (0..20_000).map(|i| (i * 50_000, 7)).collect();
            let lost = 1.0 - stamps(&effects, &input).len() as f64 / 20_000.0;
            assert!((lost - 0.2).abs() < 0.03, "{burst_us}: {lost}");
        }
    }
}

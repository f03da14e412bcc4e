//! The host: its clocks, and when it gets what the devices send.

use super::draws::{RandomPurpose, WorldRandom};
use super::scene::World;
use evrig_core::pi_camera::ClockSandwich;
use evrig_core::time::{Span, Stamp};
use evrig_session::{ClockExchange, HostTime};

/// The host had been running for so long at world time zero.
const HOST_UPTIME: Span = Span::from_micros(20_000_000_000);
/// A USB packet and the driver's thread take at least so long, and on average so much longer.
const USB: [f64; 2] = [400e-6, 200e-6];
/// The same for a message over a quiet network, one way.
const NETWORK: [f64; 2] = [120e-6, 60e-6];
/// Between two readings of a clock in one process.
const READING: [f64; 2] = [150e-9, 100e-9];
/// The link's speed. A Pi's own gigabit cannot carry raw and RGB at full rate; this one can.
const LINK_BYTES_PER_S: f64 = 2.5e9 / 8.0;

/// What a delay belongs to; no two kinds share a draw.
#[derive(Debug, Clone, Copy)]
#[repr(u64)]
enum HostLink {
    Packet = 1,
    Frame,
    Exchange,
}

impl World {
    /// Both clocks of the host at a world time; they do not drift and are never set.
    #[must_use]
    pub fn host_time(&self, time: Span) -> HostTime {
        let monotonic = Stamp::from_nanos(0) + HOST_UPTIME + time;
        HostTime { monotonic, unix: self.clocks.unix(time) }
    }

    /// World time at which the host has packet number `number` of the DAVIS, whole at `sent`.
    #[must_use]
    pub fn packet_arrival(&self, sent: Span, number: u64) -> Span {
        sent + delay(USB, &mut self.link(HostLink::Packet, number))
    }

    /// World time at which the host has `n_bytes` of the Pi's frame `sequence`, sent at `sent`.
    #[must_use]
    pub fn frame_arrival(&self, sent: Span, n_bytes: usize, sequence: u64) -> Span {
        let transfer = Span::from_secs_f64(n_bytes as f64 / LINK_BYTES_PER_S);
        sent + transfer + delay(NETWORK, &mut self.link(HostLink::Frame, sequence))
    }

    /// The Pi's clocks as the host gets them when it asks at `asked`; world time of the answer.
    #[must_use]
    pub fn clock_exchange(&self, asked: Span, number: u64) -> (Span, ClockExchange) {
        let mut draws = self.link(HostLink::Exchange, number);
        let before = asked + delay(NETWORK, &mut draws);
        let middle = before + delay(READING, &mut draws);
        let after = middle + delay(READING, &mut draws);
        let answered = after + delay(NETWORK, &mut draws);
        let pi = ClockSandwich {
            boottime_before: self.clocks.pi_boot(before),
            realtime: self.clocks.pi_wall(middle),
            boottime_after: self.clocks.pi_boot(after),
        };
        let [asked, received] = [asked, answered].map(|time| self.host_time(time));
        (answered, ClockExchange { asked, pi, pi_raw: None, answered: received })
    }

    fn link(&self, way: HostLink, number: u64) -> WorldRandom {
        WorldRandom::new(self.seed, RandomPurpose::HostLink, way as u64, number)
    }
}

fn delay([least, more]: [f64; 2], draws: &mut WorldRandom) -> Span {
    Span::from_secs_f64(least + more * draws.exponential())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::test_world::TestWorld;

    #[test]
    fn a_reading_of_the_pis_clock_lies_between_the_hosts_two() {
        let mut stage = TestWorld::still("plain");
        stage.description.clocks.pi_wall_offset_us = 250.0;
        let world = stage.world();
        for number in 0..50_u32 {
            let asked = Span::from_micros(1_000 * i64::from(number));
            let (answered, exchange) = world.clock_exchange(asked, u64::from(number));
            let offset = exchange.pi.realtime - exchange.asked.unix - Span::from_micros(250);
            let round_trip = exchange.answered.unix - exchange.asked.unix;
            assert!(Span::from_micros(120) <= offset && offset < round_trip, "{exchange:?}");
            assert!(exchange.pi.boottime_before < exchange.pi.boottime_after);
            assert_eq!(exchange.answered, world.host_time(answered));
        }
    }
}

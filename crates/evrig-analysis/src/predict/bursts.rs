//! Hazard of the bursts that follow the camera's own frames.

use super::pass::PixelPass;

impl PixelPass<'_> {
    /// ON and OFF events that bursts cause between two positions, in ascending order of calls.
    pub(super) fn burst_events(&mut self, from: f64, to: f64) -> [f64; 2] {
        let bursts = self.signal.bursts;
        let mut sum = [0.0; 2];
        if self.next_burst >= bursts.len() {
            return sum;
        }
        let us = |at: f64| self.signal.start_us + at * self.signal.step_us;
        let [from, to] = [us(from), us(to)];
        while bursts.get(self.next_burst).is_some_and(|burst| burst.to_us <= from) {
            self.next_burst += 1;
        }
        let open = bursts[self.next_burst..].iter().take_while(|burst| burst.from_us < to);
        for burst in open {
            let seconds = 1e-6 * (to.min(burst.to_us) - from.max(burst.from_us)).max(0.0);
            let factor = self.law.burst_factor;
            sum = [0, 1].map(|side| sum[side] + factor * burst.hz[side] * seconds);
        }
        sum
    }

    /// Rate of a polarity that bursts cause at the present position, Hz.
    pub(super) fn burst_hz(&self, side: usize) -> f64 {
        let bursts = self.signal.bursts;
        let us = self.signal.start_us + self.position * self.signal.step_us;
        let open = bursts[self.next_burst..].iter().take_while(|burst| burst.from_us <= us);
        let now = open.filter(|burst| us < burst.to_us);
        self.law.burst_factor * now.map(|burst| burst.hz[side]).sum::<f64>()
    }
}

//! Repeated timing: medians with their spread.

use crate::Result;
use std::time::{Duration, Instant};

/// Calls before the timed ones, which create pipelines and fill caches.
const WARM_UP: usize = 2;

/// How often a call is repeated.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Calls are repeated until they have taken this long …
    pub budget: Duration,
    /// … but at least this often,
    pub least: usize,
    /// and at most this often.
    pub most: usize,
}

impl Timing {
    /// The timing of the benchmark.
    pub fn new(quick: bool) -> Timing {
        match quick {
            true => Timing {
                budget: Duration::from_millis(300),
                least: 3,
                most: 50,
            },
            false => Timing {
                budget: Duration::from_millis(1500),
                least: 5,
                most: 200,
            },
        }
    }

    /// Calls `call` repeatedly; returns the milliseconds of a call.
    ///
    /// # Errors
    /// As `call`.
    pub fn measure(&self, mut call: impl FnMut() -> Result<()>) -> Result<Spread> {
        for _ in 0..WARM_UP {
            call()?;
        }
        let (mut samples, begin) = (Vec::new(), Instant::now());
        while samples.len() < self.least
            || (begin.elapsed() < self.budget && samples.len() < self.most)
        {
            let start = Instant::now();
            call()?;
            samples.push(start.elapsed().as_secs_f64() * 1e3);
        }
        Ok(Spread::from_samples(samples))
    }
}

/// Median and range of repetitions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The median.
    pub median: f64,
    /// The smallest.
    pub low: f64,
    /// The largest.
    pub high: f64,
    /// The number of repetitions.
    pub repetitions: usize,
}

impl Spread {
    /// Returns the spread of `samples`; NaN without any.
    pub fn from_samples(mut samples: Vec<f64>) -> Spread {
        samples.sort_by(f64::total_cmp);
        let at = |i: usize| samples.get(i).copied().unwrap_or(f64::NAN);
        Spread {
            median: at(samples.len() / 2),
            low: at(0),
            high: at(samples.len().saturating_sub(1)),
            repetitions: samples.len(),
        }
    }

    /// Returns milliseconds a call, with `count` items each, as items per second.
    pub fn per_second(self, count: f64) -> Spread {
        let rate = |ms: f64| count * 1e3 / ms;
        Spread {
            median: rate(self.median),
            low: rate(self.high),
            high: rate(self.low),
            repetitions: self.repetitions,
        }
    }

    /// Returns the milliseconds of calls with `count` items as milliseconds per item.
    pub fn per_item(self, count: f64) -> Spread {
        Spread {
            median: self.median / count,
            low: self.low / count,
            high: self.high / count,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn calls_are_repeated_within_their_limits() {
        let timing = Timing {
            budget: Duration::ZERO,
            least: 4,
            most: 9,
        };
        let mut calls = 0;
        let spread = timing
            .measure(|| {
                calls += 1;
                Ok(())
            })
            .unwrap();
        assert_eq!((calls, spread.repetitions), (WARM_UP + 4, 4));
    }

    #[test]
    fn rates_exchange_the_extremes() {
        let spread = Spread::from_samples(vec![4.0, 2.0, 1.0]);
        assert_eq!((spread.low, spread.median, spread.high), (1.0, 2.0, 4.0));
        let rate = spread.per_second(8.0);
        assert_eq!((rate.low, rate.median, rate.high), (2e3, 4e3, 8e3));
    }
}

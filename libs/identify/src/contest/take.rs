//! Taking a cause for good: where it moves the data far, everything is linearized anew around it, and it must keep its gain there.

use super::{Contest, Refined};
use crate::evidence::Cell;
use crate::sensitivity::Column;
use fss_multibody::ModelError;
use fss_plant::{Effect, Place};
use nalgebra::DVector;

/// Mean square by which whitened rows of a window may move before everything is linearized anew, and how often that is done.
const FAR: f64 = 1.0;
const MOST_CENTRES: usize = 3;
/// So many of the best in the screen are asked anew then; what the others would do is taken to be as before.
const ASKED_ANEW: usize = 50;
/// An exchange of wires is tried first where it gains this share of what the best gains.
const EXCHANGE_SHARE: f64 = 0.7;
/// Cosine beyond which what comes in small for nothing looks like a cause.
const ALIKE: f64 = 0.2;
/// So many of those on which the data insist are tried, until one keeps its gain where everything is linearized anew.
const MOST_TRIED: usize = 3;

impl Contest {
    /// The best of those on which the data insist, whether what was linear before still is; or the next best, where its gain
    /// was one of linear equations only.
    pub(super) fn first_that_holds(
        &mut self,
        now: &Refined,
        contest: &[Refined],
        centre: &mut Refined,
        say: &(dyn Fn(&str) + Sync),
    ) -> Result<Option<(Refined, bool)>, ModelError> {
        let mut insistent: Vec<&Refined> = contest.iter().filter(|next| self.insists(now, next)).collect();
        // Wires are exchanged more often than thrusters are turned by a right angle: what needs no size goes first.
        let least = EXCHANGE_SHARE * insistent.first().map_or(0.0, |best| now.chi2 - best.chi2);
        let is_exchange = |next: &&Refined| {
            let last = next.hypotheses.last().map(|h| &self.hypotheses[*h]);
            last.is_some_and(|h| h.is_discrete) && now.chi2 - next.chi2 > least
        };
        insistent.sort_by_key(|next| !is_exchange(next));
        insistent.truncate(MOST_TRIED);
        for best in insistent {
            let mut next = best.clone();
            let mut is_linear = true;
            for _ in 0..MOST_CENTRES {
                if !self.is_far(centre, &next) {
                    break;
                }
                say("fitting the windows anew");
                self.centre_near(&next)?;
                next = self.refine(&next.hypotheses, &next.effects)?;
                *centre = next.clone();
                is_linear = false;
            }
            if next.chi2 < now.chi2 {
                return Ok(Some((next, is_linear)));
            }
            self.centre_near(now)?;
            *centre = now.clone();
        }
        Ok(None)
    }

    /// Linearizes anew around causes: these, the best of the screen there, and what looks like them and comes in small for nothing.
    /// A millisecond of a clock does: linear far away, its difference from a latency would be one more shape to fit with.
    fn centre_near(&mut self, around: &Refined) -> Result<(), ModelError> {
        let near = self.screen(&around.residuals, &around.hypotheses).into_iter().take(ASKED_ANEW);
        let on_their_lines = (0..self.hypotheses.len()).filter(|h| self.is_on_exchanged_line(*h, &around.effects));
        let alike = (0..self.hypotheses.len()).filter(|h| self.comes_in_like(*h, around));
        let mut asked: Vec<usize> =
            near.map(|s| s.hypothesis).chain(around.hypotheses.clone()).chain(on_their_lines).chain(alike).collect();
        asked.sort_unstable();
        asked.dedup();
        self.centre(&around.effects, &asked)
    }

    /// Whether a hypothesis comes in small for nothing and looks like a parameter of the causes.
    fn comes_in_like(&self, hypothesis: usize, causes: &Refined) -> bool {
        let looks_like = |place: usize, cause: &Column| {
            let (mut dot, mut own, mut other) = (0.0, 0.0, 0.0);
            for (columns, cause) in self.columns.iter().zip(cause) {
                let column = columns.column(place);
                dot += column.dot(cause);
                own += column.norm_squared();
                other += cause.norm_squared();
            }
            f64::abs(dot) > ALIKE * (own * other).sqrt()
        };
        let first = self.order.coordinate[hypothesis];
        let places = self.order.places[first..first + self.hypotheses[hypothesis].size()].iter().flatten();
        let mut absorbing = places.map(|(place, _)| *place).filter(|place| *place < self.nuisance_count);
        absorbing.any(|place| causes.columns.iter().any(|cause| looks_like(place, cause)))
    }

    /// Whether a hypothesis is of a thruster whose line was exchanged: whatever it would do is told by other commands then.
    fn is_on_exchanged_line(&self, hypothesis: usize, effects: &[Effect]) -> bool {
        let own = &self.hypotheses[hypothesis].nominal;
        let exchanged = effects.iter().filter(|e| e.id() == "valve_swap");
        let mut lines = exchanged.flat_map(|e| [e.index(), e.get("other_index").map(|i| i as usize)]);
        own.about().place == Place::Thruster && own.index().is_some() && lines.any(|line| line == own.index())
    }

    /// Whether the rows have moved so far that what was linear around `centre` is so no more.
    fn is_far(&self, centre: &Refined, now: &Refined) -> bool {
        let mut cells = centre.residuals.iter().zip(&now.residuals).zip(&self.evidence.cells);
        let moved =
            |((a, b), cell): ((&DVector<f64>, &DVector<f64>), &Cell)| (a - b).norm_squared() > FAR * cell.freedom;
        cells.any(moved)
    }
}

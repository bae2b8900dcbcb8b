//! The causes that the data insist on, with uncertain values where these causes leave them.

use crate::contest::{Contest, DOUBTFUL, MOST_AT_ONCE, MOST_CAUSES, Refined, Selection};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::Plant;

/// How often uncertain values are settled anew beside the causes found, where their influence is far from linear.
const SETTLED_ANEW: usize = 2;
/// What is left of the mean square where settling anew was worth another round.
const MUCH_BETTER: f64 = 0.9;

/// The causes that the data insist on. `file` is the plant as it was given.
pub(crate) fn selected(
    contest: &mut Contest,
    file: &Plant,
    runs: &[Run],
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Selection, ModelError> {
    let search = Search { file, runs, progress };
    if let Some(selection) = search.at_once(contest)? {
        return Ok(selection);
    }
    // A clamped arm is never simulated to its noise: one cause is enough to see how far from it the best model stays.
    let first = if contest.trial.plant.base.clamped { 1 } else { MOST_CAUSES };
    let mut selection = contest.select(first, progress)?;
    if contest.settles() {
        selection = search.settled(contest, selection, &[], &[], first)?;
    }
    let mut unit = selection.after.mean_square();
    // Where no cause explains all, the rows are noisier than the sensors: priors must be weighed against that.
    while unit > DOUBTFUL {
        contest.set_unit(unit);
        selection = contest.select(MOST_CAUSES, progress)?;
        if !contest.settles() {
            break;
        }
        selection = search.settled(contest, selection, &[], &[], MOST_CAUSES)?;
        let left = selection.after.mean_square();
        if left > MUCH_BETTER * unit {
            break;
        }
        unit = left;
        if unit <= DOUBTFUL {
            contest.set_unit(1.0);
            selection = search.settled(contest, selection, &[], &[], MOST_CAUSES)?;
        }
    }
    Ok(selection)
}

struct Search<'a> {
    file: &'a Plant,
    runs: &'a [Run],
    progress: &'a (dyn Fn(&str) + Sync),
}

impl Search<'_> {
    /// Begun with the causes that everything fitted at once comes down to, where the plant file is far from what was measured;
    /// `None` where these are not what it was.
    fn at_once(&self, contest: &mut Contest) -> Result<Option<Selection>, ModelError> {
        if !contest.settles() || !contest.is_far_off(&contest.nothing()?) {
            return Ok(None);
        }
        (self.progress)("fitting everything at once");
        let settled = contest.place();
        let mut alone = Vec::new();
        for start in contest.at_once(self.file)? {
            alone.push((contest.settle_from(&start, self.file, self.runs)?, contest.place()));
        }
        alone.sort_by(|a, b| a.0.chi2.total_cmp(&b.0.chi2));
        let mut alone = alone.into_iter();
        if let Some((Refined { hypotheses, effects, .. }, place)) = alone.next() {
            let instead: Vec<Refined> = alone.map(|(other, _)| other).collect();
            contest.go_back(place, &effects, self.runs)?;
            let begun = contest.select_beside(&hypotheses, &effects, instead.clone(), MOST_AT_ONCE, self.progress)?;
            let selection = self.settled(contest, begun, &hypotheses, &instead, MOST_AT_ONCE)?;
            if !selection.after.hypotheses.is_empty() && selection.after.mean_square() < DOUBTFUL {
                return Ok(Some(selection));
            }
        }
        contest.go_back(settled, &[], self.runs)?;
        Ok(None)
    }

    /// The selection once uncertain values have given back what they took up of its causes, as often as that changes it; beside
    /// these causes they have already.
    fn settled(
        &self,
        contest: &mut Contest,
        begun: Selection,
        beside: &[usize],
        instead: &[Refined],
        most: usize,
    ) -> Result<Selection, ModelError> {
        let mut selection = begun;
        for _ in 0..SETTLED_ANEW {
            let Refined { hypotheses, effects, .. } = &selection.after;
            // What a cause moves little, uncertain values followed linearly.
            if hypotheses == beside || !contest.is_far_off(&selection.before) {
                break;
            }
            (self.progress)("settling uncertain values beside these causes");
            let here = contest.place();
            let effects = contest.settle_anew(hypotheses, effects, self.file, self.runs)?;
            let instead = if hypotheses.len() == 1 { instead.to_vec() } else { Vec::new() };
            let again = contest.select_beside(hypotheses, &effects, instead, most, self.progress)?;
            if again.after.mean_square() > selection.after.mean_square() {
                contest.go_back(here, &selection.after.effects, self.runs)?;
                break;
            }
            let is_the_same = again.after.hypotheses == *hypotheses;
            selection = again;
            if is_the_same {
                break;
            }
        }
        Ok(selection)
    }
}

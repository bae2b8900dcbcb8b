//! Values over time, one strip below the other on a common axis: lines, valves as a raster, phases as a band, events as marks.

use super::page::escape;
use std::fmt::Write;

/// The most points of a line; more are thinned to their extremes.
const POINTS: usize = 600;
/// Room for numbers left of the strips, and between the strips for their titles, in the picture's own units.
const LEFT: f64 = 58.0;
const RIGHT: f64 = 12.0;
const TITLE: f64 = 20.0;
/// Colours of lines, in their order: distinguishable, also in print.
pub(crate) const COLOURS: [&str; 8] =
    ["#2b6ca3", "#b3402a", "#2f7d4f", "#b8860b", "#6b4c9a", "#177e89", "#8a5a44", "#555555"];

/// One line of a strip.
pub(crate) struct Line<'a> {
    /// Its name for the legend; empty where the title says enough.
    pub name: &'a str,
    /// Its colour.
    pub colour: &'a str,
    /// Time (s) and value; where the value is not finite the line has a gap.
    pub points: Vec<(f64, f64)>,
}

/// Something that lasted.
pub struct Span {
    /// Begin and end, s.
    pub during_s: [f64; 2],
    /// Its name.
    pub name: String,
}

/// Something that happened.
pub(crate) struct Mark {
    /// When, s.
    pub at_s: f64,
    /// Its colour.
    pub colour: &'static str,
    /// What.
    pub text: String,
}

/// Strips on one time axis.
pub(crate) struct Strips {
    svg: String,
    corner: [f64; 2],
    width: f64,
    span_s: [f64; 2],
    bottom: f64,
    /// Times of the lines that go through all strips, s.
    through_s: Vec<f64>,
}

impl Strips {
    /// Strips below `corner` that are `width` wide with their numbers, over `span_s`.
    pub(crate) fn new(corner: [f64; 2], width: f64, span_s: [f64; 2]) -> Self {
        let span_s = [span_s[0], span_s[1].max(span_s[0] + 1e-6)];
        Self { svg: String::new(), corner, width, span_s, bottom: corner[1], through_s: Vec::new() }
    }

    /// Thin lines through all strips that follow, where something changed.
    pub(crate) fn through(&mut self, times_s: impl IntoIterator<Item = f64>) {
        let [from, to] = self.span_s;
        self.through_s.extend(times_s.into_iter().filter(|t| *t > from && *t < to));
    }

    fn plot_width(&self) -> f64 {
        self.width - LEFT - RIGHT
    }

    fn x(&self, time_s: f64) -> f64 {
        let [from, to] = self.span_s;
        self.corner[0] + LEFT + self.plot_width() * ((time_s - from) / (to - from)).clamp(0.0, 1.0)
    }

    /// Makes room for a strip, draws its title, frame and grid; gives its upper edge.
    fn frame(&mut self, title: &str, height: f64) -> f64 {
        let top = self.bottom + TITLE;
        self.bottom = top + height;
        let (left, width) = (self.corner[0] + LEFT, self.plot_width());
        let _ = write!(
            self.svg,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"#fcfcfb\" \
             stroke=\"#bbb\"/><text x=\"{left:.1}\" y=\"{:.1}\" font-size=\"12\">{}</text>",
            top - 5.0,
            escape(title)
        );
        let mut grid = String::new();
        for (time_s, _) in ticks(self.span_s, 8) {
            let _ = write!(grid, "M{:.1} {top:.1}v{height:.1}", self.x(time_s));
        }
        let _ = write!(self.svg, "<path d=\"{grid}\" stroke=\"#ebebe8\"/>");
        let mut through = String::new();
        for time_s in &self.through_s {
            let _ = write!(through, "M{:.1} {top:.1}v{height:.1}", self.x(*time_s));
        }
        let _ = write!(self.svg, "<path d=\"{through}\" stroke=\"#9a9a92\" stroke-dasharray=\"2 3\"/>");
        top
    }

    /// Lines in one strip whose range covers at least `least` of the value.
    pub(crate) fn lines(&mut self, title: &str, height: f64, least: f64, lines: &[Line]) {
        self.lines_in_band(title, height, least, lines, None);
    }

    /// The same over a band from `-band` to `band`: what noise alone would do.
    pub(crate) fn lines_in_band(&mut self, title: &str, height: f64, least: f64, lines: &[Line], band: Option<f64>) {
        let top = self.frame(title, height);
        let [from, to] = self.span_s;
        let shown = |point: &&(f64, f64)| point.0 >= from && point.0 <= to && point.1.is_finite();
        let values = || lines.iter().flat_map(|line| line.points.iter().filter(shown)).map(|point| point.1);
        if values().next().is_none() {
            let _ = write!(
                self.svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#777\" font-size=\"11\">none</text>",
                self.corner[0] + LEFT + 8.0,
                top + 18.0
            );
            return;
        }
        let [low, high] = range(values().chain(band).chain(band.map(|b| -b)), least);
        let y = |value: f64| top + height * (high - value.clamp(low, high)) / (high - low);
        if let Some(band) = band {
            let _ = write!(
                self.svg,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#dbe9f6\"/>",
                self.corner[0] + LEFT,
                y(band),
                self.plot_width(),
                y(-band) - y(band)
            );
        }
        self.value_axis([low, high], &y);
        for line in lines {
            let points: Vec<_> = line.points.iter().filter(|p| p.0 >= from && p.0 <= to).copied().collect();
            let mut d = String::new();
            let mut pen = 'M';
            for (time_s, value) in thinned(&points, POINTS) {
                if value.is_finite() {
                    let _ = write!(d, "{pen}{:.1} {:.1}", self.x(time_s), y(value));
                    pen = 'L';
                } else {
                    pen = 'M';
                }
            }
            let _ = write!(
                self.svg,
                "<path d=\"{d}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.2\" stroke-linejoin=\"round\"/>",
                line.colour
            );
        }
        self.legend(top, lines.iter().map(|line| (line.name, line.colour)));
    }

    /// Grid lines at round values and their numbers; `y` is where a value lies.
    fn value_axis(&mut self, [low, high]: [f64; 2], y: &impl Fn(f64) -> f64) {
        let mut numbers = String::new();
        let marks = ticks([low, high], 4);
        for (value, label) in if marks.len() < 2 { ticks([low, high], 8) } else { marks } {
            let stroke = if value == 0.0 { "#aaa" } else { "#ebebe8" };
            let _ = write!(
                self.svg,
                "<path d=\"M{:.1} {:.1}h{:.1}\" stroke=\"{stroke}\"/>",
                self.corner[0] + LEFT,
                y(value),
                self.plot_width()
            );
            let _ = write!(
                numbers,
                "<text x=\"{:.1}\" y=\"{:.1}\">{label}</text>",
                self.corner[0] + LEFT - 5.0,
                y(value) + 3.5
            );
        }
        let _ = write!(self.svg, "<g font-size=\"10\" fill=\"#555\" text-anchor=\"end\">{numbers}</g>");
    }

    /// Names in their colours, right-aligned above a strip.
    fn legend<'a>(&mut self, top: f64, entries: impl Iterator<Item = (&'a str, &'a str)>) {
        let named = entries.filter(|(name, _)| !name.is_empty());
        let words: Vec<_> =
            named.map(|(name, colour)| format!("<tspan fill=\"{colour}\">{}</tspan>", escape(name))).collect();
        let _ = write!(
            self.svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"11\">{}</text>",
            self.corner[0] + self.width - RIGHT,
            top - 5.0,
            words.join(" &#160; ")
        );
    }

    /// Rows that are dark while something is on, as valves.
    pub(crate) fn raster(&mut self, title: &str, rows: &[(String, Vec<[f64; 2]>)]) {
        const ROW: f64 = 11.0;
        let top = self.frame(title, ROW * rows.len() as f64);
        for (k, (name, on_s)) in rows.iter().enumerate() {
            let y = top + ROW * (k as f64 + 0.5);
            let _ = write!(
                self.svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"10\" fill=\"#555\">{}</text>",
                self.corner[0] + LEFT - 5.0,
                y + 3.5,
                escape(name)
            );
            let mut d = String::new();
            for [from, to] in on_s.iter().filter(|on| on[1] >= self.span_s[0] && on[0] <= self.span_s[1]) {
                let x = self.x(*from);
                let _ = write!(d, "M{x:.2} {y:.1}h{:.2}", (self.x(*to) - x).max(0.15));
            }
            let colour = COLOURS[k % 2];
            let _ = write!(self.svg, "<path d=\"{d}\" stroke=\"{colour}\" stroke-width=\"{:.1}\"/>", ROW - 3.0);
        }
    }

    /// What followed upon what, with names where they fit.
    pub(crate) fn band(&mut self, title: &str, spans: &[Span]) {
        const HEIGHT: f64 = 18.0;
        let top = self.frame(title, HEIGHT);
        for (k, span) in spans.iter().enumerate() {
            let (from, to) = (self.x(span.during_s[0]), self.x(span.during_s[1]));
            let fill = ["#d6e4f0", "#efe3cf"][k % 2];
            let name = escape(&span.name);
            let _ = write!(
                self.svg,
                "<g><title>{name}</title><rect x=\"{from:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{HEIGHT}\" fill=\"{fill}\" \
                 stroke=\"#fff\"/>",
                to - from
            );
            if to - from > 6.0 * span.name.chars().count() as f64 {
                let _ = write!(
                    self.svg,
                    "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"11\">{name}</text>",
                    0.5 * (from + to),
                    top + 13.0
                );
            }
            self.svg.push_str("</g>");
        }
    }

    /// Triangles where something happened; their words show under the pointer.
    pub(crate) fn marks(&mut self, title: &str, marks: &[Mark]) {
        const HEIGHT: f64 = 14.0;
        let top = self.frame(title, HEIGHT);
        for mark in marks.iter().filter(|mark| mark.at_s >= self.span_s[0] && mark.at_s <= self.span_s[1]) {
            let _ = write!(
                self.svg,
                "<path d=\"M{:.1} {:.1}l4 10h-8z\" fill=\"{}\"><title>{:.2} s: {}</title></path>",
                self.x(mark.at_s),
                top + 2.0,
                mark.colour,
                mark.at_s,
                escape(&mark.text)
            );
        }
    }

    /// Draws the time axis; gives the SVG and its lower edge.
    pub(crate) fn finish(mut self) -> (String, f64) {
        self.svg.push_str("<g font-size=\"10\" fill=\"#555\" text-anchor=\"middle\">");
        let marks = ticks(self.span_s, 8);
        let last = marks.len().saturating_sub(1);
        for (k, (time_s, label)) in marks.into_iter().enumerate() {
            let unit = if k == last { " s" } else { "" };
            let _ = write!(
                self.svg,
                "<text x=\"{:.1}\" y=\"{:.1}\">{label}{unit}</text>",
                self.x(time_s),
                self.bottom + 13.0
            );
        }
        self.svg.push_str("</g>");
        (self.svg, self.bottom + 18.0)
    }
}

/// Smallest and largest value with some room, at least `least` apart.
fn range(values: impl Iterator<Item = f64>, least: f64) -> [f64; 2] {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let middle = 0.5 * (low + high);
    let half = (0.54 * (high - low)).max(0.5 * least).max(1e-12 * middle.abs().max(1e-300));
    [middle - half, middle + half]
}

/// Round values within a range, at most about `most` of them, as they are written.
fn ticks([low, high]: [f64; 2], most: usize) -> Vec<(f64, String)> {
    let rough = (high - low) / most as f64;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|s| *s >= rough).unwrap_or(power);
    let decimals = (-(step * 1.0001).log10().floor()).max(0.0) as usize;
    let (first, last) = ((low / step).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last)
        .map(|k| {
            let value = k as f64 * step;
            (value, if decimals > 5 { format!("{value:.1e}") } else { format!("{value:.decimals$}") })
        })
        .collect()
}

/// At most about `most` points: of each bin its smallest and its largest value, so that nothing that stands out is lost.
pub(crate) fn thinned(points: &[(f64, f64)], most: usize) -> Vec<(f64, f64)> {
    let bin = (2 * points.len()).div_ceil(most).max(1);
    if bin <= 2 {
        return points.to_vec();
    }
    let mut out = Vec::with_capacity(most + 2);
    for chunk in points.chunks(bin) {
        let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (Some(low), Some(high)) = (chunk.iter().min_by(by_value), chunk.iter().max_by(by_value)) else { continue };
        let (a, b) = if low.0 <= high.0 { (low, high) } else { (high, low) };
        out.extend([*a, *b]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_survives_thinning() {
        let mut points: Vec<(f64, f64)> = (0..10_000).map(|k| (f64::from(k), 0.0)).collect();
        points[5_003].1 = 7.0;
        let few = thinned(&points, 500);
        assert!(few.len() <= 502 && few.contains(&(5_003.0, 7.0)), "{} points", few.len());
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let labels = |range, most| ticks(range, most).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels([-0.3, 1.1], 4), ["0.0", "0.5", "1.0"]);
        assert_eq!(labels([0.0, 90.1], 8), ["0", "20", "40", "60", "80"]);
        assert_eq!(labels([-1.2e-4, 1.2e-4], 4), ["-0.0001", "0.0000", "0.0001"]);
    }
}

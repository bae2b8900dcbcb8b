//! A plane in metres on paper: axes with ticks, a grid, polygons, a scene from above.

use fss_plant::scene::{COLOURS, Posture, Scene, Shape};
use std::fmt::Write;

/// Room for the numbers at the axes, in the picture's own units.
const MARGIN: [f64; 4] = [62.0, 34.0, 18.0, 46.0];

/// One plot of a picture: a window of the plane, x to the right, y up, both to the same scale.
pub(crate) struct Plot {
    svg: String,
    name: String,
    /// Upper left corner of the plot on paper, and its size.
    corner: [f64; 2],
    size: [f64; 2],
    /// Left and upper edge of the window, m.
    origin_m: [f64; 2],
    scale: f64,
}

/// Line and fill of a shape, as SVG attributes.
pub(crate) type Style<'a> = &'a str;

impl Plot {
    /// A plot `width` wide whose corner on paper is `corner` and that shows `[x0, x1]` by `[y0, y1]` in m. Names tell
    /// the plots of one picture apart.
    pub(crate) fn new(name: &str, corner: [f64; 2], width: f64, x_m: [f64; 2], y_m: [f64; 2]) -> Self {
        let scale = width / (x_m[1] - x_m[0]);
        let size = [width, (y_m[1] - y_m[0]) * scale];
        let corner = [corner[0] + MARGIN[0], corner[1] + MARGIN[1]];
        let mut plot = Self { svg: String::new(), name: name.into(), corner, size, origin_m: [x_m[0], y_m[1]], scale };
        let [left, top] = plot.corner;
        let _ = write!(
            plot.svg,
            "<clipPath id=\"{name}\"><rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{:.1}\"/></clipPath>\
             <rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{0:.1}\" fill=\"white\"/>",
            plot.size[1]
        );
        plot.grid();
        plot
    }

    /// Size on paper, margins included.
    pub(crate) fn outer_size(&self) -> [f64; 2] {
        [self.size[0] + MARGIN[0] + MARGIN[2], self.size[1] + MARGIN[1] + MARGIN[3]]
    }

    /// A place on paper.
    pub(crate) fn at(&self, point_m: [f64; 2]) -> [f64; 2] {
        [
            self.corner[0] + (point_m[0] - self.origin_m[0]) * self.scale,
            self.corner[1] + (self.origin_m[1] - point_m[1]) * self.scale,
        ]
    }

    /// Distance between ticks: 1, 2 or 5 times a power of ten, up to eight of them.
    fn tick_m(&self) -> f64 {
        let rough = self.size[0] / self.scale / 8.0;
        let power = 10_f64.powf(rough.log10().floor());
        [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|tick| *tick >= rough).unwrap_or(power)
    }

    fn grid(&mut self) {
        let tick = self.tick_m();
        let decimals = (-tick.log10().floor()).max(0.0) as usize;
        let [left, top] = self.corner;
        let (bottom, right) = (top + self.size[1], left + self.size[0]);
        let range = |from: f64, to: f64| (from / tick).ceil() as i64..=(to / tick + 1e-9).floor() as i64;
        for k in range(self.origin_m[0], self.origin_m[0] + self.size[0] / self.scale) {
            let [x, _] = self.at([k as f64 * tick, 0.0]);
            let _ = write!(
                self.svg,
                "<path d=\"M{x:.1} {top:.1}V{bottom:.1}\" stroke=\"#e4e4e4\"/><text x=\"{x:.1}\" y=\"{:.1}\" \
                 text-anchor=\"middle\">{:.decimals$}</text>",
                bottom + 17.0,
                k as f64 * tick
            );
        }
        for k in range(self.origin_m[1] - self.size[1] / self.scale, self.origin_m[1]) {
            let [_, y] = self.at([0.0, k as f64 * tick]);
            let _ = write!(
                self.svg,
                "<path d=\"M{left:.1} {y:.1}H{right:.1}\" stroke=\"#e4e4e4\"/><text x=\"{:.1}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{:.decimals$}</text>",
                left - 6.0,
                y + 4.0,
                k as f64 * tick
            );
        }
        let _ = write!(
            self.svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">x, m</text>\
             <text transform=\"translate({:.1} {:.1}) rotate(-90)\" text-anchor=\"middle\">y, m</text>",
            0.5 * (left + right),
            bottom + 36.0,
            left - 44.0,
            0.5 * (top + bottom)
        );
    }

    /// A heading above the plot.
    pub(crate) fn heading(&mut self, text: &str) {
        let [left, top] = self.corner;
        let _ = write!(self.svg, "<text x=\"{left:.1}\" y=\"{:.1}\" font-size=\"14\">{text}</text>", top - 12.0);
    }

    /// A closed polygon.
    pub(crate) fn polygon(&mut self, points_m: &[[f64; 2]], style: Style) {
        let d = self.path(points_m);
        let _ = write!(self.svg, "<path clip-path=\"url(#{})\" d=\"{d}Z\" {style}/>", self.name);
    }

    /// A line through points.
    pub(crate) fn line(&mut self, points_m: &[[f64; 2]], style: Style) {
        let d = self.path(points_m);
        let _ = write!(self.svg, "<path clip-path=\"url(#{})\" d=\"{d}\" fill=\"none\" {style}/>", self.name);
    }

    fn path(&self, points_m: &[[f64; 2]]) -> String {
        let mut d = String::new();
        for (i, point) in points_m.iter().enumerate() {
            let [x, y] = self.at(*point);
            let _ = write!(d, "{}{x:.1} {y:.1}", if i == 0 { "M" } else { "L" });
        }
        d
    }

    /// A circle of `radius_m`.
    pub(crate) fn circle(&mut self, center_m: [f64; 2], radius_m: f64, style: Style) {
        self.ellipse(center_m, [radius_m; 2], 0.0, style);
    }

    /// An ellipse whose first semi-axis points in direction `angle_rad`.
    pub(crate) fn ellipse(&mut self, center_m: [f64; 2], semi_axes_m: [f64; 2], angle_rad: f64, style: Style) {
        let [x, y] = self.at(center_m);
        let _ = write!(
            self.svg,
            "<g clip-path=\"url(#{})\"><ellipse rx=\"{:.2}\" ry=\"{:.2}\" transform=\"translate({x:.1} {y:.1}) rotate({:.2})\" {style}/></g>",
            self.name,
            semi_axes_m[0] * self.scale,
            semi_axes_m[1] * self.scale,
            -angle_rad.to_degrees()
        );
    }

    /// A cross, of one size on paper whatever the scale.
    pub(crate) fn cross(&mut self, point_m: [f64; 2], style: Style) {
        let [x, y] = self.at(point_m);
        let _ = write!(self.svg, "<path d=\"M{:.1} {y:.1}h12m-6 -6v12\" {style}/>", x - 6.0);
    }

    /// Words, their left end or `anchor` at a place.
    pub(crate) fn label(&mut self, point_m: [f64; 2], anchor: &str, text: &str) {
        let [x, y] = self.at(point_m);
        let _ = write!(
            self.svg,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" stroke=\"white\" stroke-width=\"3\" \
             paint-order=\"stroke\">{text}</text>"
        );
    }

    /// What is beyond this edge, in the room's colour.
    pub(crate) fn beyond(&mut self, edge: &Shape) {
        let ([left, top], [width, height]) = (self.corner, self.size);
        let (d, stroke, fill) = (self.path(&edge.corners_m), edge.stroke, COLOURS.beyond);
        self.clipped(&format!(
            "<path d=\"M{left:.1} {top:.1}h{width:.1}v{height:.1}h-{width:.1}Z{d}Z\" fill=\"{fill}\" fill-rule=\"evenodd\" \
             stroke=\"{stroke}\"/>"
        ));
    }

    /// SVG of the caller's own, clipped to the plot.
    pub(crate) fn clipped(&mut self, svg: &str) {
        let _ = write!(self.svg, "<g clip-path=\"url(#{})\">{svg}</g>", self.name);
    }

    /// The bodies of a scene where a posture has them.
    pub(crate) fn scene(&mut self, scene: &Scene, posture: &Posture, opacity: f64) {
        let mut svg = format!("<g opacity=\"{opacity}\" stroke-width=\"1.5\">");
        for (shape, pose) in scene.placed(posture) {
            let d = self.path(&shape.at(pose));
            let _ = write!(svg, "<path d=\"{d}Z\" fill=\"{}\" stroke=\"{}\"/>", shape.fill, shape.stroke);
        }
        svg.push_str("</g>");
        self.clipped(&svg);
    }

    /// The plot's SVG, its frame on top.
    pub(crate) fn finish(mut self) -> String {
        let ([left, top], [width, height]) = (self.corner, self.size);
        let _ = write!(
            self.svg,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"none\" stroke=\"#444\"/>"
        );
        self.svg
    }
}

/// A picture of plots on white paper.
pub(crate) fn picture(size: [f64; 2], content: &str) -> String {
    let [width, height] = size;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"sans-serif\" \
         font-size=\"12\"><rect width=\"{width:.0}\" height=\"{height:.0}\" fill=\"white\"/>{content}</svg>\n"
    )
}

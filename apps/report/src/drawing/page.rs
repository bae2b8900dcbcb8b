//! A self-contained HTML page: one look for all that commands leave to be read.

use std::fmt::Display;
use std::fmt::Write;

/// Everything before the content. A page refers to nothing outside itself.
pub(crate) fn head(window_title: &str, heading: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{}</title><style>{STYLE}</style><h1>{}</h1>",
        escape(window_title),
        escape(heading)
    )
}

/// Everything behind it.
pub(crate) const FOOT: &str = "</html>\n";

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:980px;margin:2em auto;padding:0 1em;color:#222}\
    table{border-collapse:collapse;font-size:13px;margin:.6em 0;display:block;max-width:100%;overflow-x:auto}\
    td,th{padding:.2em .6em;text-align:right;border-bottom:1px solid #ddd;vertical-align:top}\
    td:first-child,th:first-child,.text td,.text th{text-align:left}\
    .far{background:#fbd9d3}.near{background:#e4f3e1}.numbers{font-variant-numeric:tabular-nums}\
    h2{margin-top:2em}h3{margin:1.4em 0 .2em;font-size:1em}svg{display:block}\
    .verdict{font-size:1.25em;border-left:5px solid #2b6ca3;padding:.4em 1em;background:#f2f7fb}\
    .bad{border-color:#b3402a;background:#fdf1ee}.caption{color:#555;font-size:13px;margin-top:.2em}\
    pre{font-size:12px;background:#f7f7f5;padding:.8em;overflow-x:auto}\
    details{margin:1em 0}summary{cursor:pointer;color:#2b6ca3}\
    @media print{body{margin:0;max-width:none;font-size:11pt}h2,h3{break-after:avoid}svg,tr{break-inside:avoid}}";

/// Text as it may stand in HTML or SVG, between tags or in an attribute.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// A table; its cells are escaped. `class` is `numbers` or `text`.
pub(crate) fn table<Row, Cell>(html: &mut String, class: &str, header: &[&str], rows: impl IntoIterator<Item = Row>)
where
    Row: IntoIterator<Item = Cell>,
    Cell: Display,
{
    let _ = write!(html, "<table class=\"{class}\">");
    if !header.is_empty() {
        html.push_str("<tr>");
        for cell in header {
            let _ = write!(html, "<th>{}</th>", escape(cell));
        }
        html.push_str("</tr>");
    }
    for row in rows {
        html.push_str("<tr>");
        for cell in row {
            let _ = write!(html, "<td>{}</td>", escape(&cell.to_string()));
        }
        html.push_str("</tr>");
    }
    html.push_str("</table>");
}

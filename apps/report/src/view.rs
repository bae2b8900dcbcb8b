//! `fss view`: a page on the loopback: the table from above, plumes, traces, strips, health; of a log, or of a running stack.

mod frame;
mod live;
mod logged;
mod server;

use clap::Args;
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result, WrapErr};
use server::{Content, Server, Stream};
use std::collections::BTreeMap;
use std::net::{Ipv4Addr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;

/// Show a flight in the browser: a log with play, pause and scrub, or the stack that runs.
///
/// The page is served on 127.0.0.1 and nowhere else; it needs no internet and loads nothing from outside. Stop with Ctrl-C.
/// A live view only reads, beside the flight: it cannot command, and flight processes do not wait for it.
///
/// From another computer: ssh -L 8300:127.0.0.1:8300 HOST, and open <http://127.0.0.1:8300/> there.
#[derive(Args)]
pub struct ViewArgs {
    /// The log, an MCAP file, or a run's folder; the running stack where absent.
    log: Option<PathBuf>,
    /// The port on 127.0.0.1; 0 takes a free one.
    #[arg(long, default_value_t = 8300)]
    port: u16,
    #[command(flatten)]
    stack: live::StackArgs,
}

/// The page's own files.
const PAGE: &[(&str, &str, &str)] = &[
    ("/", "text/html; charset=utf-8", include_str!("view/page/index.html")),
    ("/view.css", "text/css", include_str!("view/page/view.css")),
    ("/view.js", "text/javascript", include_str!("view/page/view.js")),
    ("/above.js", "text/javascript", include_str!("view/page/above.js")),
    ("/strips.js", "text/javascript", include_str!("view/page/strips.js")),
];

/// Serves the page until it is interrupted.
pub fn run(args: &ViewArgs) -> Result<()> {
    let address = (Ipv4Addr::LOCALHOST, args.port);
    let listener = TcpListener::bind(address).into_diagnostic().wrap_err_with(|| {
        format!(
            "cannot listen on 127.0.0.1:{}; another view may run: give another --port, or 0 for a free one",
            args.port
        )
    })?;
    let mut files: BTreeMap<String, Content> = PAGE
        .iter()
        .map(|(path, kind, text)| ((*path).to_owned(), Content { kind, bytes: text.as_bytes().to_vec() }))
        .collect();
    let mut json = |path: &str, text: String| {
        files.insert(path.to_owned(), Content { kind: "application/json", bytes: text.into_bytes() });
    };
    if let Some(path) = &args.log {
        let (scene, flight) = logged::read(&Log::open(path).into_diagnostic()?)?;
        json("/scene.json", scene);
        json("/flight.json", flight);
        serve(listener, files, None)?.run();
        return Ok(());
    }
    let watch = live::Watch::join(&args.stack)?;
    json("/scene.json", watch.scene_json()?);
    let stream = Arc::new(Stream::default());
    let server = serve(listener, files, Some(stream.clone()))?;
    std::thread::spawn(move || server.run());
    watch.run(&stream)
}

fn serve(listener: TcpListener, files: BTreeMap<String, Content>, stream: Option<Arc<Stream>>) -> Result<Server> {
    let server = Server::new(listener, files, stream).into_diagnostic()?;
    say!("http://127.0.0.1:{}/   (Ctrl-C ends)", server.port());
    Ok(server)
}

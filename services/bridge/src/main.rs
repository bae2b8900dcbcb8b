//! `fss-bridge`: samples to and from other vehicles, as a program of its own. The launcher starts it as `fss service bridge`.

use clap::Parser;
use crossbeam::queue::ArrayQueue;
use fss_bridge::device::{Device, Network};
use fss_bridge::{Bridge, HEARD_QUEUE, Line, Patience, SAID_QUEUE};
use fss_bus::Service;
use fss_service::{Process, SiteArgs, explain_errors};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};
use tracing_subscriber::EnvFilter;

/// Exchange samples with other vehicles over the network.
#[derive(Parser)]
#[command(name = "fss-bridge", version)]
struct Cli {
    #[command(flatten)]
    site: SiteArgs,
}

fn main() -> Result<()> {
    explain_errors();
    tracing_subscriber::fmt().with_writer(std::io::stderr).with_env_filter(EnvFilter::from_default_env()).init();
    let site = Process::open(Bridge::NAME, &Cli::parse().site)?;
    let endpoints = site.launch.bridge.clone().ok_or_else(|| miette!("the launch file has no [bridge]"))?;
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    let session = since.into_diagnostic().wrap_err("the calendar clock is unset")?.as_nanos() as u64;
    let neighbours = site.bus.neighbours();
    let (line, words) = (Line::default(), Arc::new(ArrayQueue::new(16)));
    let patience = Patience { max_age: endpoints.max_age(), silent_after: endpoints.silent_after() };
    let bridge = Bridge::new(neighbours, patience, line.clone(), words.clone());
    let _network = Device::start(Network {
        vehicle: site.launch.vehicle.clone(),
        session,
        endpoints,
        receive: neighbours.received().cloned().collect(),
        said: site.queue(SAID_QUEUE)?,
        heard: site.queue(HEARD_QUEUE)?,
        words,
        line,
    })
    .into_diagnostic()?;
    site.fly(bridge, || ())?;
    Ok(())
}

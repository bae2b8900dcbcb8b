//! `fss-bridge`: samples to and from other vehicles, and to nodes of ROS 2, as a program of its own. The launcher starts it as `fss service bridge`.

use clap::Parser;
use crossbeam_queue::ArrayQueue;
use fss_bridge::device::{Device, Network};
use fss_bridge::inward::Inward;
use fss_bridge::{Bridge, CALLED_QUEUE, HEARD_QUEUE, Line, Patience, ROS2_QUEUE, SAID_QUEUE, ros2};
use fss_bus::Service;
use fss_bus::launch::Ros2;
use fss_messages::MAX_LINKS;
use fss_plant::Plant;
use fss_plant::urdf::ArmFrames;
use fss_service::{PLANT_FILE, Process, SiteArgs, explain_errors};
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
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    let session = since.into_diagnostic().wrap_err("the calendar clock is unset")?.as_nanos() as u64;
    let neighbours = site.bus.neighbours();
    let (line, words) = (Line::default(), Arc::new(ArrayQueue::new(16)));
    let endpoints = site.launch.bridge.clone();
    let patience = endpoints.as_ref().map_or_else(Patience::default, |endpoints| Patience {
        max_age: endpoints.max_age(),
        silent_after: endpoints.silent_after(),
    });
    let mut bridge = Bridge::new(neighbours, patience, line.clone(), words.clone());
    let network = |endpoints| -> Result<Device> {
        let (vehicle, receive) = (site.launch.vehicle.clone(), neighbours.received().cloned().collect());
        let (said, heard) = (site.queue(SAID_QUEUE)?, site.queue(HEARD_QUEUE)?);
        let (line, words) = (line.clone(), words.clone());
        Device::start(Network { vehicle, session, endpoints, receive, said, heard, words, line }).into_diagnostic()
    };
    let _network = endpoints.map(network).transpose()?;
    let nodes = |ros2: Ros2| -> Result<(Inward, ros2::Device)> {
        let plant = Plant::parse(&site.read(PLANT_FILE)?).map_err(|e| miette!("{PLANT_FILE}: {e}"))?;
        let inward = Inward::new(&ros2.receive, ArmFrames::of(&plant, MAX_LINKS).joints);
        let vehicle = site.launch.vehicle.clone();
        let queues =
            ros2::Queues { said: site.queue(ROS2_QUEUE)?, called: site.queue(CALLED_QUEUE)?, words: words.clone() };
        let others = site.bus.program_topics();
        let nodes = ros2::Nodes::new((vehicle, ros2), &plant, others, queues, line.clone())
            .map_err(|e| miette!("[ros2] share: {e}"))?;
        Ok((inward, ros2::Device::start(nodes).into_diagnostic()?))
    };
    let _nodes = match site.launch.ros2.clone().map(nodes).transpose()? {
        Some((inward, device)) => {
            bridge = bridge.with_nodes(inward);
            Some(device)
        }
        None => None,
    };
    site.fly(bridge, || ())?;
    Ok(())
}

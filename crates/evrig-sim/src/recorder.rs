//! A camera's client together with its simulated twin: the same wire, with longer time-outs.

use super::davis::DavisServer;
use super::live::LiveWorld;
use super::pi::SimulatedSource;
use super::progress::TwinProgress;
use evrig_device::davis::{NetworkDavis, NetworkDavisTimeouts};
use evrig_device::pi::{AgentAddress, NetworkPi, PiTimeouts};
use evrig_pi::agent::Agent;
use evrig_pi::order::CaptureOrder;
use evrig_record::Finding;
use evrig_record::recorder::{
    PreparedRecorder, Recorder, RecorderError, RecorderTally, SampleSender,
};
use evrig_session::trajectory::StepSettings;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

/// A twin that has sent everything is silent until the slower one has too; the engine notices when
/// neither makes progress.
const SILENCE: Duration = Duration::from_secs(600);

/// A simulated camera, recorded over its real wire.
pub struct SimulatedCamera {
    /// Dropped first: it holds connections to the server.
    client: Box<dyn Recorder>,
    live: Arc<LiveWorld>,
    progress: TwinProgress,
    /// Whether all packets sent must have arrived before the connection is closed.
    counts_packets: bool,
    _server: TwinServer,
}

/// The server of the twin, kept alive.
enum TwinServer {
    Davis { _server: DavisServer },
    Pi { _agent: Agent },
}

fn loopback() -> SocketAddr {
    (Ipv4Addr::LOCALHOST, 0).into()
}

fn failed(device: &str, error: impl ToString) -> RecorderError {
    RecorderError {
        device: device.to_owned(),
        because: error.to_string(),
        remedy: "is the loopback interface up?",
    }
}

impl SimulatedCamera {
    /// The simulated DAVIS.
    ///
    /// # Errors
    /// When it cannot be served on the loopback interface.
    pub fn davis(live: &Arc<LiveWorld>) -> Result<Self, RecorderError> {
        let server = DavisServer::serve(Arc::clone(live), loopback())
            .map_err(|error| failed("the simulated davis", error))?;
        let addresses: Vec<_> = server.addresses().iter().map(ToString::to_string).collect();
        let patience = NetworkDavisTimeouts { silence: SILENCE, ..NetworkDavisTimeouts::default() };
        Ok(Self {
            client: Box::new(NetworkDavis::new(&addresses.join(","), patience)),
            live: Arc::clone(live),
            progress: server.progress().clone(),
            counts_packets: true,
            _server: TwinServer::Davis { _server: server },
        })
    }

    /// The simulated camera of the Pi.
    ///
    /// # Errors
    /// When it cannot be served on the loopback interface.
    pub fn pi(live: &Arc<LiveWorld>, order: CaptureOrder) -> Result<Self, RecorderError> {
        let source = SimulatedSource::new(Arc::clone(live));
        let progress = source.progress();
        let agent = Agent::serve(loopback(), Box::new(source))
            .map_err(|error| failed("the simulated pi", error))?;
        let reach = AgentAddress::Local { address: agent.address().to_string() };
        let patience = PiTimeouts { silence: SILENCE, ..PiTimeouts::default() };
        Ok(Self {
            client: Box::new(NetworkPi::new(reach, order, patience)),
            live: Arc::clone(live),
            progress,
            counts_packets: false,
            _server: TwinServer::Pi { _agent: agent },
        })
    }
}

impl Recorder for SimulatedCamera {
    fn name(&self) -> &'static str {
        self.client.name()
    }

    fn check(&mut self) -> Vec<Finding> {
        self.client.check()
    }

    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        let mut prepared = self.client.prepare()?;
        if let Some(description) = prepared.description.as_object_mut() {
            description.insert("is_simulated".to_owned(), true.into());
        }
        Ok(prepared)
    }

    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError> {
        self.progress.begin(self.live.now());
        self.client.start(outlet)
    }

    fn set(&mut self, settings: &StepSettings) -> Vec<String> {
        // Light and exposure are of the world: the first camera that receives them sets them for
        // all.
        if self.counts_packets {
            self.live.set(settings);
        }
        Vec::new()
    }

    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        self.client.progress()
    }

    fn settle(&mut self) -> Result<f64, RecorderError> {
        let share = self.progress.share(self.live.close());
        let tally = self.client.progress()?;
        if share < 1.0 || !self.counts_packets {
            return Ok(share);
        }
        let (n_sent, n_came) = (self.progress.look().n_sent, tally.n_samples + tally.n_dropped);
        Ok(if n_came >= n_sent { 1.0 } else { 0.999 })
    }

    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        self.client.finish()
    }

    fn abort(&mut self) {
        self.client.abort();
    }
}

//! One lease from arrival to the last acknowledgement.

use std::{sync::Arc, time::Instant};

use bytes::Bytes;
use common::{
    job::LeaseId,
    pass::Work,
    plan::Trial,
    protocol::{FailureCause, Lease, Preparation, RESULT_CONTENT_TYPE, RenderSettings, UnitId},
    result::UnitResult,
};
use reqwest::{Method, header::CONTENT_TYPE};
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio_util::task::TaskTracker;
use tracer::UnitRender;

use crate::{
    endpoint::transfer_timeout,
    pool::{Outcome, Wish, guarded},
    scenes::ReadyScene,
    service::{Hold, Session},
};

/// Results are mostly noise: more effort saves little.
const COMPRESSION_LEVEL: i32 = 1;

/// Units of a lease that will not come, and why.
#[derive(Debug)]
pub(crate) struct Report {
    pub lease: LeaseId,
    pub units: Vec<UnitId>,
    pub cause: FailureCause,
    pub message: String,
}

/// How a unit ended, ready to be sent.
enum Ended {
    Done(Bytes),
    Failed(String),
    Returned,
    Cancelled,
}

/// Render a lease and hand in what comes of it. `place` is given up when the threads are done with it,
/// `hold` when the coordinator has everything.
pub(crate) async fn work(session: Arc<Session>, hold: Hold, lease: Lease, place: Option<OwnedSemaphorePermit>) {
    let (lease, hold) = (Arc::new(lease), Arc::new(hold));
    let report = |cause, units, message: String| Report { lease: lease.id, units, cause, message };
    let all = || lease.units.iter().map(|unit| unit.id).collect::<Vec<_>>();
    if lease.tracer != tracer::VERSION {
        let message = format!("this worker renders {}, the job wants {}", tracer::VERSION, lease.tracer);
        return session.give_back(&hold, report(FailureCause::Returned, all(), message)).await;
    }
    let ready = tokio::select! {
        biased;
        () = hold.cancelled.cancelled() => return,
        () = session.draining.cancelled() => {
            return session.give_back(&hold, report(FailureCause::Returned, all(), "the worker leaves".into())).await;
        }
        ready = session.scenes.get(lease.scene, &lease.settings) => ready,
    };
    let ready = match ready {
        Ok(ready) => ready,
        Err(message) => return session.give_back(&hold, report(FailureCause::Failed, all(), message)).await,
    };

    let (sender, mut ended) = mpsc::unbounded_channel();
    let threads = {
        let (session, lease, cancelled) = (Arc::clone(&session), Arc::clone(&lease), hold.cancelled.clone());
        tokio::task::spawn_blocking(move || {
            let wish = || match () {
                () if cancelled.is_cancelled() => Wish::Cancel,
                () if session.leaving.is_cancelled() => Wish::Return,
                () if session.draining.is_cancelled() => Wish::Finish,
                () => Wish::GoOn,
            };
            render(&session, &lease, &ready, wish, &sender);
        })
    };
    let uploads = TaskTracker::new();
    let mut returned = Vec::new();
    while let Some((unit, ended)) = ended.recv().await {
        match ended {
            Ended::Done(body) => {
                session.unacknowledged.send_modify(|waiting| *waiting += 1);
                let (session, lease) = (Arc::clone(&session), lease.id);
                let hold = Arc::clone(&hold);
                uploads.spawn(async move {
                    if let Err(message) = hand_in(&session, lease, unit, body).await {
                        let report = Report { lease, units: vec![unit], cause: FailureCause::Failed, message };
                        session.give_back(&hold, report).await;
                    }
                    session.unacknowledged.send_modify(|waiting| *waiting -= 1);
                });
            }
            Ended::Failed(message) => {
                session.give_back(&hold, report(FailureCause::Failed, vec![unit], message)).await;
            }
            Ended::Returned => returned.push(unit),
            Ended::Cancelled => {}
        }
    }
    // The channel is closed, hence the threads are done; a panic outside of units would show here.
    if let Err(error) = threads.await {
        session.give_back(&hold, report(FailureCause::Failed, all(), error.to_string())).await;
    }
    drop(place);
    session.give_back(&hold, report(FailureCause::Returned, returned, "the worker leaves".into())).await;
    uploads.close();
    uploads.wait().await;
}

fn render(
    session: &Session,
    lease: &Lease,
    ready: &ReadyScene,
    wish: impl Fn() -> Wish + Sync,
    ended: &mpsc::UnboundedSender<(UnitId, Ended)>,
) {
    // A send fails only when the lease's task is gone, and then nobody wants the result.
    let tell = |id, how| drop(ended.send((id, how)));
    let mut units = Vec::with_capacity(lease.units.len());
    for unit in &lease.units {
        if let Work::Prepare { trial } = &unit.work {
            tell(unit.id, prepare(session, lease, ready, trial));
            continue;
        }
        match guarded(|| UnitRender::new(&ready.prepared, &lease.settings, unit)) {
            Ok(render) => units.push((unit.id, render)),
            Err(panic) => tell(unit.id, Ended::Failed(panic)),
        }
    }
    session.pool.render(&units, wish, |id, outcome| {
        tell(
            id,
            match outcome {
                Outcome::Done(mut result, rejected) => {
                    if let Some(rejected) = rejected
                        && session.scenes.is_news(&format!("not finite: {}", lease.scene))
                    {
                        tracing::warn!("{}", replay(lease, rejected));
                    }
                    result.statistics.load_seconds = ready.load.charge();
                    result.statistics.build_seconds = ready.build.charge();
                    pack(&result).map_or_else(Ended::Failed, Ended::Done)
                }
                Outcome::Failed(message) => Ended::Failed(message),
                Outcome::Returned => Ended::Returned,
                Outcome::Cancelled => Ended::Cancelled,
            },
        );
    });
}

/// Choose the method of a job.
fn prepare(session: &Session, lease: &Lease, ready: &ReadyScene, trial: &Trial) -> Ended {
    let start = Instant::now();
    let choose = || session.pool.install(|| tracer::pilot::choose(&ready.prepared, &lease.settings, trial));
    let plan = match guarded(choose) {
        Ok(plan) => plan,
        Err(panic) => return Ended::Failed(panic),
    };
    // All threads were at it.
    let cpu_seconds = start.elapsed().as_secs_f64() * session.pool.threads() as f64;
    let packed = serde_json::to_vec(&Preparation { plan, cpu_seconds }).map_err(|error| error.to_string());
    packed.and_then(|json| compress(&json)).map_or_else(Ended::Failed, Ended::Done)
}

/// What to say of a sample that was not finite.
fn replay(lease: &Lease, [x, y, sample]: [u32; 3]) -> String {
    let RenderSettings { frame, resolution: [w, h], seed, .. } = lease.settings;
    format!(
        "a sample of scene {} is not finite and was left out; replay it by: tessera render SCENE --pixel {x},{y} \
         --sample {sample} --frames {frame} --resolution {w}x{h} --seed {seed}, and the job's other options",
        lease.scene
    )
}

fn pack(result: &UnitResult) -> Result<Bytes, String> {
    compress(&result.encode())
}

fn compress(plain: &[u8]) -> Result<Bytes, String> {
    let packed = zstd::bulk::compress(plain, COMPRESSION_LEVEL);
    packed.map(Bytes::from).map_err(|error| format!("the result cannot be compressed: {error}"))
}

/// Hand in a result, however long the coordinator is away. A result that it has already, or no longer
/// wants, is dropped.
async fn hand_in(session: &Session, lease: LeaseId, unit: UnitId, body: Bytes) -> Result<(), String> {
    let Ok(_permit) = session.uploads.acquire().await else { return Ok(()) };
    let endpoint = &session.link.endpoint;
    let call = || {
        let request = endpoint.request(Method::PUT, &format!("/leases/{lease}/units/{unit}"));
        let request = request.header(CONTENT_TYPE, RESULT_CONTENT_TYPE).timeout(transfer_timeout(body.len()));
        endpoint.send(request.body(body.clone()))
    };
    match session.link.persist(call).await {
        Ok(_) => Ok(()),
        Err(error) if matches!(error.refusal(), Some(404 | 409 | 410)) => {
            tracing::debug!(%lease, %unit, "not wanted any more: {error}");
            Ok(())
        }
        Err(error) => Err(format!("the result was refused: {error}")),
    }
}

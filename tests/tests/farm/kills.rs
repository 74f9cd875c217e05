//! Units are pure: whoever renders them, however often, and whoever dies meanwhile, the pixels are the same.

use std::path::Path;

use common::job::JobState;

use crate::processes::{Coordinator, Process, pixels, repository, succeed, wait};

/// Some seconds of work for two cores, in tiles small enough that everybody gets many.
const JOB: [&str; 6] = ["--resolution", "96x96", "--tile", "16", "--samples", "512"];

fn scene() -> String {
    repository("scenes/cornell-box.json").to_str().unwrap().to_string()
}

/// Render in one process with so many threads.
fn render(folder: &Path, threads: &str) -> Vec<(String, Vec<u32>)> {
    let out = folder.join(format!("{threads}.exr"));
    let (scene, out_text) = (scene(), out.to_str().unwrap());
    succeed(&[&["render", &scene, "-o", out_text, "--threads", threads], &JOB[..]].concat());
    pixels(&out)
}

/// Submit and follow in a process of its own.
fn submit(farm: &Coordinator, out: &Path) -> Process {
    let (scene, out) = (scene(), out.to_str().unwrap());
    let submit = ["submit", &scene, "--watch", "-o", out, "--coordinator", &farm.url];
    Process::start(&[&submit[..], &JOB[..]].concat())
}

pub fn assert_same(a: &[(String, Vec<u32>)], b: &[(String, Vec<u32>)]) {
    let names = |pixels: &[(String, Vec<u32>)]| pixels.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!(names(a), names(b));
    for ((name, a), (_, b)) in a.iter().zip(b) {
        let different = a.iter().zip(b).filter(|(a, b)| a != b).count();
        assert_eq!(different, 0, "channel {name}: {different} of {} pixels differ", a.len());
    }
    let colour = a.iter().find(|(name, _)| name == "G").expect("a picture has green");
    assert!(colour.1.iter().any(|bits| f32::from_bits(*bits) > 0.1), "the picture is not black");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pixels_do_not_depend_on_threads_workers_or_who_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let alone = render(folder.path(), "1");
    assert_same(&alone, &render(folder.path(), "2"));
    assert_same(&alone, &with_a_worker_killed(&folder.path().join("worker")).await);
    assert_same(&alone, &with_the_coordinator_killed(&folder.path().join("coordinator")).await);
}

/// Three workers: one is killed in the middle while it holds a lease, one joins late.
async fn with_a_worker_killed(folder: &Path) -> Vec<(String, Vec<u32>)> {
    let farm = Coordinator::start(&folder.join("data")).await;
    let mut victim = farm.worker("victim");
    let _other = farm.worker("other");
    let out = folder.join("out");
    let mut submit = submit(&farm, &out);
    let id = farm.the_job().await;
    wait("the victim's first result", async || Some(farm.named("victim").await).filter(|worker| worker.units > 0))
        .await;

    // Stopped, it keeps what it holds: once nothing more of it arrives, what it is said to hold is so.
    wait("a victim with a lease", async || {
        victim.signal("STOP");
        let mut counts = Vec::new();
        while counts.len() < 4 || counts[counts.len() - 4..].windows(2).any(|pair| pair[0] != pair[1]) {
            counts.push(farm.named("victim").await.leased);
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
        if counts.last() > Some(&0) {
            return Some(());
        }
        victim.signal("CONT");
        None
    })
    .await;
    victim.kill();
    let held = farm.named("victim").await;
    let job = farm.job(id).await;
    assert!(held.leased > 0 && held.units > 0, "it was killed in the middle of its work: {held:?}");
    assert!(job.progress > 0.0 && job.progress < 1.0, "the kill fell in mid-render: {}", job.progress);

    let _late = farm.worker("late");
    let units = wait("the late worker's first result", async || {
        Some(farm.named("late").await.units).filter(|units| *units > 0)
    })
    .await;
    assert!(units > 0);
    assert_eq!(submit.code().await, 0, "{}", submit.log());
    let job = farm.job(id).await;
    assert_eq!((job.state, job.progress), (JobState::Completed, 1.0));
    let lost = farm.named("victim").await;
    assert!(lost.state == "lost" || job.statistics.retries > 0 || lost.leased == 0, "{lost:?}");
    pixels(&out.join("frame-0001.exr"))
}

/// The coordinator is killed in the middle and started again; workers and submitter stay.
async fn with_the_coordinator_killed(folder: &Path) -> Vec<(String, Vec<u32>)> {
    let mut farm = Coordinator::start(&folder.join("data")).await;
    let workers = [farm.worker("one"), farm.worker("two")];
    let out = folder.join("out");
    let mut submit = submit(&farm, &out);
    let id = farm.the_job().await;
    let before = farm.job_when(id, "some progress", |job| job.progress > 0.1).await;
    assert!(before.progress < 1.0);
    farm.kill_and_restart().await;
    let after = farm.job(id).await;
    assert!(after.progress < 1.0, "the kill fell in mid-render: {}", after.progress);
    assert!(after.samples >= before.samples, "what was acknowledged is there: {} {}", before.samples, after.samples);
    assert_eq!(submit.code().await, 0, "{}", submit.log());
    for worker in &workers {
        let log = worker.log();
        assert!(log.matches("cannot be reached").count() <= 1, "a worker says it once: {log}");
    }
    assert_eq!(farm.job(id).await.state, JobState::Completed);
    pixels(&out.join("frame-0001.exr"))
}

/// A worker that dies while it tries methods for a job: another one tries them anew, with the same outcome.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_is_prepared_by_another_when_its_worker_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let job = ["--resolution", "384x256", "--samples", "16", "--direct", "auto"];
    let scene = repository("scenes/veach-plates.json").to_str().unwrap().to_string();
    let alone = folder.path().join("alone.exr");
    succeed(&[&["render", &scene, "-o", alone.to_str().unwrap(), "--threads", "1"], &job[..]].concat());
    // Methods are tried for a fraction of a second: where that was over before the worker could be killed, once more.
    for attempt in 0..10 {
        let folder = folder.path().join(attempt.to_string());
        let farm = Coordinator::start(&folder.join("data")).await;
        let out = folder.join("out");
        let submit = ["submit", &scene, "--watch", "-o", out.to_str().unwrap(), "--coordinator", &farm.url];
        let mut submit = Process::start(&[&submit[..], &job[..]].concat());
        let id = farm.the_job().await;
        let mut victim = farm.worker("victim");
        wait("a worker that holds a unit", async || {
            let list: common::protocol::WorkerList = farm.get("/workers").await?;
            list.workers.into_iter().find(|worker| worker.machine == "victim" && worker.leased > 0)
        })
        .await;
        victim.kill();
        let left = farm.job(id).await;
        if left.plan.is_some() {
            continue;
        }
        assert_eq!((left.samples, left.progress), (0, 0.0), "nothing is rendered before the method is known");
        let _next = farm.worker("next");
        assert_eq!(submit.code().await, 0, "{}", submit.log());
        let done = farm.job(id).await;
        assert_eq!(done.state, JobState::Completed);
        assert!(done.plan.is_some_and(|plan| plan.untried.is_none()), "methods were tried");
        assert_eq!(farm.named("victim").await.units, 0, "what it held came from another");
        assert_same(&pixels(&alone), &pixels(&out.join("frame-0001.exr")));
        return;
    }
    panic!("no worker was killed while it tried methods");
}

/// A worker that dies while it is the only one: its units come back when its heartbeats stop, and somebody
/// who comes later renders them.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn units_of_a_lost_worker_return_when_its_heartbeats_stop() {
    let folder = tempfile::tempdir().unwrap();
    let farm = Coordinator::start(&folder.path().join("data")).await;
    let mut victim = farm.worker("victim");
    let mut submit = submit(&farm, &folder.path().join("out"));
    let id = farm.the_job().await;
    farm.job_when(id, "a beginning", |job| job.progress > 0.0).await;
    victim.kill();
    let dead = farm.job(id).await;
    assert!(dead.progress < 1.0);
    let lost = wait("the loss to be noticed", async || {
        Some(farm.named("victim").await).filter(|worker| worker.state == "lost")
    })
    .await;
    assert_eq!(lost.leased, 0, "a lost worker holds nothing");
    let _next = farm.worker("next");
    assert_eq!(submit.code().await, 0, "{}", submit.log());
    let done = farm.job(id).await;
    assert_eq!(done.state, JobState::Completed);
    assert_eq!(done.samples, 96 * 96 * 512, "every sample once");
}

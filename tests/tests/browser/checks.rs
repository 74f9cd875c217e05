//! What is checked in the browser, each with a coordinator of its own.

use std::{future::Future, pin::Pin};

use serde_json::{Value, json};

use crate::{
    page::Page,
    processes::{Coordinator, Process, repository, wait},
};

type Check = fn(Page) -> Pin<Box<dyn Future<Output = ()>>>;

macro_rules! checks {
    ($($name:ident),+ $(,)?) => {
        /// All checks, by name.
        pub const ALL: &[(&str, Check)] = &[$((stringify!($name), |page| Box::pin($name(page)))),+];
    };
}

checks! {
    a_dropped_scene_is_rendered_before_the_eyes,
    a_mesh_is_dropped_with_its_files,
    jobs_are_steered,
    a_worker_that_is_killed_is_seen_to_go,
    a_coordinator_that_goes_away_is_said_so_and_comes_back,
    frames_play,
    only_what_changed_is_drawn_again,
    what_clients_sent_is_text,
    pages_fit_and_can_be_read_by_all,
    the_api_can_be_browsed,
}

/// A coordinator with its data folder.
struct Farm {
    coordinator: Coordinator,
    _folder: tempfile::TempDir,
}

impl Farm {
    async fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Farm { coordinator: Coordinator::start(folder.path()).await, _folder: folder }
    }

    fn url(&self, view: &str) -> String {
        format!("{}/#/{view}", self.coordinator.url)
    }

    fn worker(&self, name: &str) -> Process {
        self.coordinator.worker(name)
    }

    async fn post(&self, path: &str, body: &Value) -> Value {
        let url = format!("{}/api/v1{path}", self.coordinator.url);
        let answer = reqwest::Client::new().post(url).json(body).send().await.unwrap();
        assert!(answer.status().is_success(), "{}", answer.text().await.unwrap());
        answer.json().await.unwrap()
    }

    /// Submit a small scene that takes so many samples a pixel.
    async fn submit(&self, name: &str, samples: u32) -> String {
        let body = json!({ "name": name, "scene": scene(), "tile": 16, "quality": { "target": "samples", "samples": samples } });
        self.post("/jobs", &body).await["id"].as_str().unwrap().to_owned()
    }
}

fn scene() -> Value {
    json!({
        "tessera": 1,
        "name": "a ball",
        "camera": { "position": [0, 1, 5], "target": [0, 1, 0] },
        "film": { "width": 96, "height": 64 },
        "shapes": [
            { "type": "sphere", "center": [0, 3, 0], "radius": 0.5, "emission": [9, 8, 7] },
            { "type": "sphere", "center": [0, 0.8, 0], "radius": 0.8 },
            { "type": "quad", "vertices": [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]] },
        ],
    })
}

/// Drop files, by path and text, on the page.
async fn drop_files(page: &Page, files: &[(&str, String)]) {
    let script = "const data = new DataTransfer();
        for (const [name, text] of arguments[0]) data.items.add(new File([text], name));
        document.body.dispatchEvent(new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer: data }));";
    page.run(script, vec![json!(files)]).await;
}

/// A sum over the pixels of the image on the page: another image has another one.
const SUM: &str = "(() => { const c = document.querySelector('canvas.pixels'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
                   let sum = 0; for (let i = 0; i < d.length; i++) sum = (31 * sum + d[i]) % 1000000007; return sum; })()";

async fn sum(page: &Page) -> i64 {
    page.run(&format!("return {SUM}"), vec![]).await.as_i64().unwrap()
}

async fn a_dropped_scene_is_rendered_before_the_eyes(page: Page) {
    let farm = Farm::start().await;
    page.goto(&farm.url("jobs")).await;
    page.says("#link", "live").await;
    page.says("main", "No jobs yet").await;

    // A scene that names a file: without it the page says so, with it the job begins.
    let mut scene = scene();
    scene["shapes"][1] = json!({ "type": "mesh", "file": "meshes/block.obj" });
    let mesh = "v -1 0 0\nv 1 0 0\nv 0 1.5 0\nf 1 2 3\n";
    drop_files(&page, &[("ball.json", scene.to_string())]).await;
    page.says("#chosen", "ball.json").await;
    page.press("#submit-go").await;
    page.says("#submit-said", "meshes/block.obj").await;
    drop_files(&page, &[("block.obj", mesh.into())]).await;
    page.says("#chosen", "block.obj").await;
    page.press("#submit [value=samples]").await;
    page.run("document.getElementById('samples').value = 256", vec![]).await;
    page.press("#submit-go").await;
    page.until("location.hash === '#/job/j1'").await;
    page.says("h2", "a ball").await;
    let empty = sum(&page).await;

    // It grows as a worker renders, and finishes.
    let worker = farm.worker("easel");
    page.until(&format!("{SUM} !== {empty}")).await;
    page.says("article .state", "completed").await;
    page.until("document.querySelector('.stage').dataset.tiles === '2'").await;
    page.says(".facts", "100.0 %").await;
    page.until("document.querySelector('#convergence').naturalWidth > 0").await;

    // The maps are other pictures, each with its legend; the image comes back as it was, and brighter is another one, too.
    let drawn = "document.querySelector('.stage').dataset.tiles === '2'";
    let mut seen = Vec::new();
    for (map, unit) in [("samples", "samples per pixel"), ("error", "standard error"), ("image", "")] {
        page.press(&format!("[data-map={map}]")).await;
        page.until(drawn).await;
        page.says(".legend", unit).await;
        seen.push(sum(&page).await);
    }
    assert!(seen[0] != seen[1] && seen[1] != seen[2] && seen[0] != seen[2], "{seen:?}");
    let expose =
        "const e = document.getElementById('exposure'); e.value = arguments[0]; e.dispatchEvent(new Event('input'))";
    page.run(expose, vec![json!(2)]).await;
    assert_ne!(sum(&page).await, seen[2]);
    page.run(expose, vec![json!(0)]).await;
    assert_eq!(sum(&page).await, seen[2]);

    // Keys zoom.
    let zoom = page.run("return Number(document.querySelector('.stage').dataset.zoom)", vec![]).await.as_f64().unwrap();
    page.run("document.querySelector('.stage').dispatchEvent(new KeyboardEvent('keydown', { key: '+' }))", vec![])
        .await;
    page.until(&format!("Number(document.querySelector('.stage').dataset.zoom) > {zoom}")).await;

    // Each attempt at a unit is told.
    page.press(".log summary").await;
    page.says("#attempts", "done").await;
    page.run(
        "const s = document.querySelector('.log select'); s.value = 'hung'; s.dispatchEvent(new Event('change'))",
        vec![],
    )
    .await;
    page.says(".log [role=status]", "No attempt is like that").await;

    // A finer target takes it on.
    page.press("[data-act=continue]").await;
    page.press("#finer-go").await;
    page.says("#sheet-title + dl", "1024 samples a pixel").await;
    drop(worker);
}

/// Other formats than Tessera's own, the mesh's materials with it, folders or not.
async fn a_mesh_is_dropped_with_its_files(page: Page) {
    let farm = Farm::start().await;
    let _worker = farm.worker("importer");
    page.goto(&farm.url("jobs")).await;
    page.says("#link", "live").await;
    let mesh = "mtllib materials/m.mtl\nv -1 0 0\nv 1 0 0\nv 0 1.5 0\nusemtl red\nf 1 2 3\n".to_owned();
    drop_files(&page, &[("notes.txt", "no scene".into())]).await;
    page.says("#chosen", "notes.txt").await;
    page.press("#submit-go").await;
    page.says("#submit-said", "a mesh (.obj or .ply)").await;
    page.press("#chosen button").await;
    drop_files(&page, &[("a.obj", mesh.clone()), ("b.ply", "ply".into())]).await;
    page.says("#chosen", "b.ply").await;
    page.press("#submit-go").await;
    page.says("#submit-said", "several meshes: a.obj, b.ply").await;
    page.press("#chosen li:nth-child(2) button").await;
    drop_files(&page, &[("m.mtl", "newmtl red\nKd 0.9 0.01 0.01\n".into())]).await;
    page.says("#chosen", "m.mtl").await;
    page.run("document.getElementById('width').value = document.getElementById('height').value = 64", vec![]).await;
    page.press("#submit [value=samples]").await;
    page.run("document.getElementById('samples').value = 16", vec![]).await;
    page.press("#submit-go").await;
    page.says("h2", "a.obj (j1)").await;
    page.says("article .state", "completed").await;
    // The material came along: what is seen of the mesh is red.
    let reddest = "const i = new Image(); i.src = arguments[0]; await i.decode(); const c = document.createElement('canvas'); \
                   c.width = i.width; c.height = i.height; const g = c.getContext('2d'); g.drawImage(i, 0, 0); \
                   const d = g.getImageData(0, 0, c.width, c.height).data; let most = 0; \
                   for (let k = 0; k < d.length; k += 4) most = Math.max(most, d[k] - d[k + 1]); window.reddest = most;";
    let url = format!("{}/api/v1/jobs/j1/frames/1/image.png", farm.coordinator.url);
    page.run(&format!("(async (...arguments) => {{ {reddest} }})(arguments[0])"), vec![json!(url)]).await;
    page.until("window.reddest > 60").await;

    // One that cannot be read is a job that says why.
    page.goto(&farm.url("jobs")).await;
    drop_files(&page, &[("bad.obj", "v 0 0 0\nf 1 2 3\n".into())]).await;
    page.says("#chosen", "bad.obj").await;
    page.press("#submit-go").await;
    page.says("article .state", "failed").await;
    page.says(".facts", "bad.obj: line 2").await;
}

async fn jobs_are_steered(page: Page) {
    let farm = Farm::start().await;
    let id = farm.submit("steered", 1 << 20).await;
    let other = farm.submit("other", 16).await;
    page.goto(&farm.url("jobs")).await;
    let of = |selector: &str| format!("[data-job={id}] {selector}");
    page.says(&of(".state"), "queued").await;
    page.press(&of("[data-act=pause]")).await;
    page.says(&of(".state"), "paused").await;
    page.press(&of("[data-act=resume]")).await;
    page.says(&of(".state"), "queued").await;
    page.press(&of("[data-act=cancel]")).await;
    page.says(&of(".state"), "canceled").await;
    page.press(&of("[data-act=requeue]")).await;
    page.says(&of(".state"), "queued").await;
    let priority = of(".priority");
    page.run(
        "const p = document.querySelector(arguments[0]); p.value = 90; p.dispatchEvent(new Event('change'))",
        vec![json!(priority)],
    )
    .await;
    wait("the priority", async || {
        let job: Value = farm.coordinator.get(&format!("/jobs/{id}")).await?;
        (job["priority"] == 90).then_some(())
    })
    .await;

    // Find and sort.
    page.run(
        "const s = document.querySelector('[type=search]'); s.value = 'oth'; s.dispatchEvent(new Event('input'))",
        vec![],
    )
    .await;
    page.until("document.querySelectorAll('.jobs > li').length === 1").await;
    page.run(
        "const s = document.querySelector('[type=search]'); s.value = ''; s.dispatchEvent(new Event('input'))",
        vec![],
    )
    .await;
    let first = "document.querySelector('.jobs > li').dataset.job";
    page.until(&format!("{first} === '{other}'")).await;
    page.run("const s = document.querySelectorAll('main select')[1]; s.value = 'priority'; s.dispatchEvent(new Event('change'))", vec![]).await;
    page.until(&format!("{first} === '{id}'")).await;

    // What is over can be deleted.
    page.press(&of("[data-act=cancel]")).await;
    page.says(&of(".state"), "canceled").await;
    page.press(&of("[data-act=delete]")).await;
    page.accept().await;
    page.until(&format!("!document.querySelector('[data-job={id}]')")).await;

    // One that comes with Tessera.
    page.press("#submit-open").await;
    page.until("document.querySelectorAll('#shipped option').length > 3").await;
    page.run("const s = document.getElementById('shipped'); s.value = 'cornell-spheres'; s.dispatchEvent(new Event('change'))", vec![]).await;
    page.press("#submit-go").await;
    page.until("location.hash === '#/job/j3'").await;
}

async fn a_worker_that_is_killed_is_seen_to_go(page: Page) {
    let farm = Farm::start().await;
    farm.submit("long", 1 << 22).await;
    let mut worker = farm.worker("doomed");
    page.goto(&farm.url("workers")).await;
    page.says("[data-worker=w1]", "doomed").await;
    page.says("[data-worker=w1]", "busy").await;
    page.says("[data-worker=w1]", "j1, frame 1").await;
    // Its tiles are outlined in its colour, which the list below the image tells.
    page.goto(&farm.url("job/j1")).await;
    page.says(".holders", "w1").await;
    page.goto(&farm.url("workers")).await;
    worker.kill();
    page.says("[data-worker=w1]", "lost").await;
    // What it held is a failed attempt that the job's page tells of.
    page.goto(&farm.url("job/j1")).await;
    page.says("#failures-title ~ div", "the worker fell silent").await;
    page.press(".log summary").await;
    page.says("#attempts", "lost").await;

    let _second = farm.worker("second");
    page.goto(&farm.url("workers")).await;
    page.says("[data-worker=w2]", "busy").await;
    page.press("[data-worker=w2] [data-act=disable]").await;
    page.says("[data-worker=w2]", "disabled").await;
    page.press("[data-worker=w2] [data-act=enable]").await;
    page.says("[data-worker=w2]", "busy").await;
    page.press("[data-worker=w2] [data-act=drain]").await;
    page.says("[data-worker=w2]", "draining").await;
}

async fn a_coordinator_that_goes_away_is_said_so_and_comes_back(page: Page) {
    let mut farm = Farm::start().await;
    let _worker = farm.worker("patient");
    farm.submit("kept", 64).await;
    page.goto(&farm.url("jobs")).await;
    page.says("[data-job=j1] .state", "completed").await;
    page.run("document.querySelector('[data-job=j1]').mine = true", vec![]).await;

    farm.coordinator.process.kill();
    page.says("#link", "away since").await;
    assert_eq!(page.text("[data-job=j1] .state").await, "completed", "what is known stays");

    // A scene submitted meanwhile waits, and becomes one job.
    drop_files(&page, &[("ball.json", scene().to_string())]).await;
    page.says("#chosen", "ball.json").await;
    page.press("#submit-go").await;
    page.says("#submit-said", "trying again").await;
    farm.coordinator.restart().await;
    page.says("#link", "live").await;
    page.until("location.hash === '#/job/j2'").await;
    page.goto(&farm.url("jobs")).await;
    page.says("[data-job=j2] .state", "").await;
    page.until("document.querySelectorAll('.jobs > li').length === 2").await;
    page.until("document.querySelector('[data-job=j2]') !== null").await;
}

async fn frames_play(page: Page) {
    let farm = Farm::start().await;
    let _worker = farm.worker("projector");
    let mut moving = scene();
    moving["animation"] =
        json!({ "camera": [{ "frame": 1, "position": [0, 1, 5] }, { "frame": 3, "position": [1, 1, 5] }] });
    let body = json!({ "scene": moving, "frames": "1-3", "quality": { "target": "samples", "samples": 16 } });
    farm.post("/jobs", &body).await;
    page.goto(&farm.url("job/j1")).await;
    page.says("article .state", "completed").await;
    page.until("document.querySelectorAll('.strip li').length === 3").await;
    page.press(".strip li:nth-child(2) button").await;
    page.until("document.querySelector('.strip li:nth-child(2) button').getAttribute('aria-current') === 'true'").await;
    page.press("[data-act=play]").await;
    page.until("!document.querySelector('.film').hidden && document.querySelector('.film').naturalWidth === 96").await;
    let first = page.run("return document.querySelector('.film').src", vec![]).await;
    page.until(&format!("document.querySelector('.film').src !== {first}")).await;
    page.press("[data-act=play]").await;
    page.until("document.querySelector('.film').hidden").await;
}

/// A hundred jobs, two hundred workers and a thousand tiles: rows stay the same elements, and those that did not change
/// are not touched.
async fn only_what_changed_is_drawn_again(page: Page) {
    let farm = Farm::start().await;
    for n in 0..100 {
        farm.submit(&format!("job {n}"), 16).await;
    }
    page.goto(&farm.url("jobs")).await;
    page.until("document.querySelectorAll('.jobs > li').length === 100").await;
    let watch = "window.touched = new Set(); new MutationObserver((all) => all.forEach(({ target }) => { if (target.tagName === 'IMG') return; \
                 const row = (target.closest ? target : target.parentElement)?.closest('[data-job], [data-worker]'); \
                 if (row) window.touched.add(row.dataset.job ?? row.dataset.worker); })) \
                 .observe(document.querySelector('main'), { subtree: true, childList: true, characterData: true, attributes: true });";
    page.run(watch, vec![]).await;
    farm.post("/jobs/j50/pause", &json!({})).await;
    page.says("[data-job=j50] .state", "paused").await;
    assert_eq!(page.run("return [...window.touched].join()", vec![]).await, json!("j50"));

    for n in 0..200 {
        let register = json!({ "machine": format!("rack {n}"), "threads": 8, "cpu_features": [], "tracer": "none", "nonce": format!("n{n}") });
        farm.post("/workers", &register).await;
    }
    page.goto(&farm.url("workers")).await;
    page.until("document.querySelectorAll('[data-worker]').length === 200").await;
    farm.post("/workers/w200/disable", &json!({})).await;
    page.says("[data-worker=w200]", "disabled").await;

    let large = json!({ "scene": scene(), "resolution": [512, 512], "tile": 16, "quality": { "target": "samples", "samples": 1 } });
    let id = farm.post("/jobs", &large).await["id"].as_str().unwrap().to_owned();
    farm.post(&format!("/jobs/{id}/pause"), &json!({})).await;
    page.goto(&farm.url(&format!("job/{id}"))).await;
    page.says("article .state", "paused").await;
    farm.post(&format!("/jobs/{id}/resume"), &json!({})).await;
    for n in 1..=100 {
        farm.post(&format!("/jobs/j{n}/cancel"), &json!({})).await;
    }
    let _worker = farm.worker("busy");
    page.says("article .state", "completed").await;
    page.until("document.querySelector('.stage').dataset.tiles === '1024'").await;
}

async fn what_clients_sent_is_text(page: Page) {
    let farm = Farm::start().await;
    let evil = "<img src=x onerror=\"window.caught=1\"><script>window.caught=1</script>";
    farm.submit(evil, 16).await;
    let register = json!({ "machine": evil, "threads": 1, "cpu_features": [], "tracer": "none", "nonce": "n" });
    farm.post("/workers", &register).await;
    for (view, selector) in [("jobs", ".name"), ("job/j1", "h2"), ("workers", "[data-worker]")] {
        page.goto(&farm.url(view)).await;
        page.says(selector, evil).await;
        let caught = page
            .run("return window.caught ?? document.querySelectorAll('main script, main [onerror]').length", vec![])
            .await;
        assert_eq!(caught, json!(0), "{view}");
    }
    // Even what got in could not run, nor speak to another host.
    let refused = page.run(
        "const s = document.createElement('script'); s.textContent = 'window.caught = 1'; document.body.append(s); return window.caught ?? 0",
        vec![],
    );
    assert_eq!(refused.await, json!(0));
}

async fn pages_fit_and_can_be_read_by_all(page: Page) {
    let farm = Farm::start().await;
    let cornell = std::fs::read_to_string(repository("scenes/cornell-spheres.json")).unwrap();
    let scene: Value = serde_json::from_str(&cornell).unwrap();
    let quality = json!({ "target": "noise", "relative_error": 0.25, "max_samples": 64 });
    let body = json!({ "scene": scene, "resolution": [256, 256], "tile": 32, "quality": quality, "tags": ["shown"] });
    farm.post("/jobs", &body).await;
    farm.submit("a second one", 1 << 22).await;
    farm.post("/jobs/j2/pause", &json!({})).await;
    let _worker = farm.worker("studio");
    let axe = std::env::var("TESSERA_AXE").ok().map(|path| std::fs::read_to_string(path).unwrap());
    if axe.is_none() {
        eprintln!("*** TESSERA_AXE is not set: axe-core was not asked, only the tree was looked at");
    }
    page.goto(&farm.url("job/j1")).await;
    page.until("Number(document.querySelector('.stage')?.dataset.tiles) > 40").await;
    page.shoot("job-growing").await;
    page.says("article .state", "completed").await;
    // The method was left open: what was tried, what was chosen, and what the scene has not.
    page.says("section[aria-labelledby=plan-title]", "methods tried").await;
    page.says("section[aria-labelledby=plan-title] dl", "opacity masks").await;
    for (scheme, width, height) in
        [("light", 1600, 1000), ("dark", 1600, 1000), ("light", 400, 860), ("dark", 400, 860)]
    {
        page.size(width, height).await;
        page.scheme(scheme).await;
        for view in ["jobs", "job/j1", "workers", "farm"] {
            page.goto(&farm.url(view)).await;
            page.says("#link", "live").await;
            let filled = "[...document.querySelectorAll('main img')].every((i) => i.hidden || (i.src.startsWith('blob:') && i.complete && i.naturalWidth > 0))";
            page.until(&format!("document.querySelector('main').innerText.length > 20 && {filled}")).await;
            if view == "job/j1" {
                page.until("document.querySelector('.stage').dataset.tiles === '64'").await;
            }
            let name = format!("{}-{scheme}-{width}", view.replace("/j1", ""));
            page.shoot(&name).await;
            if ["job/j1", "farm"].contains(&view) {
                // Charts are drawn for the colours that the reader prefers.
                let paper = page.run(PAPER, vec![]).await.as_i64().unwrap();
                assert!(if scheme == "dark" { paper < 64 } else { paper > 240 }, "{name}: {paper}");
            }
            if view == "job/j1" {
                page.press(".log summary").await;
                page.says("#attempts", "done").await;
                page.run("document.getElementById('chart-title').scrollIntoView()", vec![]).await;
                page.shoot(&format!("{name}-figures")).await;
                page.run("document.getElementById('failures-title').scrollIntoView()", vec![]).await;
                page.shoot(&format!("{name}-log")).await;
            }
            let wide =
                page.run("return document.scrollingElement.scrollWidth - innerWidth", vec![]).await.as_i64().unwrap();
            assert!(wide <= 0, "{name}: {wide} pixels too wide");
            nameless(&page, &name).await;
            if let Some(axe) = &axe {
                violations(&page, axe, &name).await;
            }
        }
        page.goto(&farm.url("jobs")).await;
        page.press("#submit-open").await;
        page.until("document.querySelectorAll('#shipped option').length > 3").await;
        page.shoot(&format!("submit-{scheme}-{width}")).await;
        if let Some(axe) = &axe {
            violations(&page, axe, "submit").await;
        }
        page.press("#submit-close").await;
    }
    // The keyboard alone gets everywhere: from the top to a job's button.
    page.size(1600, 1000).await;
    page.goto(&farm.url("jobs")).await;
    page.says("[data-job=j2] .state", "paused").await;
    let reached = "[...document.querySelectorAll('a[href], button, input, select, [tabindex=\"0\"]')] \
                   .filter((e) => e.checkVisibility() && e.tabIndex < 0).length";
    page.until(&format!("{reached} === 0")).await;
}

/// How light a chart's paper is, 0 to 255.
const PAPER: &str = "const c = document.createElement('canvas'), g = c.getContext('2d'); c.width = c.height = 1; \
                     g.drawImage(document.querySelector('.chart'), 2, 2, 1, 1, 0, 0, 1, 1); return g.getImageData(0, 0, 1, 1).data[1]";

/// Everything that can be pressed or seen as a picture has a name, and every page a heading and a main part.
async fn nameless(page: &Page, view: &str) {
    let script = "const bad = [];
        for (const e of document.querySelectorAll('button, a[href], input, select, [role=img]')) {
            if (!e.checkVisibility()) continue;
            const name = e.ariaLabel || e.innerText || e.labels?.[0]?.innerText || e.placeholder || '';
            if (!name.trim()) bad.push(e.outerHTML);
        }
        for (const e of document.querySelectorAll('img:not([alt])')) bad.push(e.outerHTML);
        if (!document.querySelector('h1') || !document.querySelector('main')) bad.push('no heading or no main');
        return bad.join('\\n')";
    let bad = page.run(script, vec![]).await;
    assert_eq!(bad, json!(""), "{view}");
}

/// What axe-core finds.
async fn violations(page: &Page, axe: &str, view: &str) {
    page.run(axe, vec![]).await;
    page.run("window.found = undefined; axe.run(document).then((r) => { window.found = r.violations; })", vec![]).await;
    page.until("window.found !== undefined").await;
    let words = "return window.found.map((v) => `${v.id} (${v.impact}): ${v.nodes.map((n) => n.html + ' ' + n.failureSummary).join('; ')}`).join('\\n')";
    let found = page.run(words, vec![]).await;
    assert_eq!(found, json!(""), "{view}");
}

async fn the_api_can_be_browsed(page: Page) {
    let farm = Farm::start().await;
    page.goto(&format!("{}/docs/", farm.coordinator.url)).await;
    page.says("#swagger-ui", "/api/v1/jobs").await;
    page.says("#swagger-ui", "Submit a job").await;
    let hosts = "return [...new Set(performance.getEntriesByType('resource').map((r) => new URL(r.name).host))].join()";
    assert_eq!(page.run(hosts, vec![]).await, json!(farm.coordinator.url.trim_start_matches("http://")));
    page.shoot("docs").await;
}

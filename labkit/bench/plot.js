// The page's side of labkit.bench.plot: picture, cards, code line and error of one bench, drawn from one message.
//
// From the kernel: {kind: "show", figure, cards, code, status} with arrays as buffers, {kind: "status", status} alone while
// a run is under way or fails, {kind: "plotly"} with plotly's code. To the kernel: {want}, {reset}, {click}, {range}.

const ARRAYS = {
    float64: Float64Array, float32: Float32Array, int32: Int32Array, uint32: Uint32Array,
    int16: Int16Array, uint16: Uint16Array, int8: Int8Array, uint8: Uint8Array,
};
const LECTURE = 1.45;  // how much larger text is in lecture mode
const FONT = 15;

// The figure with every {"$array": n, dtype, shape} replaced by a view on its buffer; objects are filled in place.
const unpack = (value, buffers) => {
    if (value === null || typeof value !== "object") return value;
    if (!("$array" in value)) {
        for (const key in value) value[key] = unpack(value[key], buffers);
        return value;
    }
    const { buffer, byteOffset, byteLength } = buffers[value.$array], Type = ARRAYS[value.dtype];
    const aligned = byteOffset % Type.BYTES_PER_ELEMENT === 0;
    const flat = aligned ? new Type(buffer, byteOffset, byteLength / Type.BYTES_PER_ELEMENT)
        : new Type(buffer.slice(byteOffset, byteOffset + byteLength));
    const [rows, columns] = value.shape;
    return columns === undefined ? flat : Array.from({ length: rows }, (_, r) => flat.subarray(r * columns, (r + 1) * columns));
};

// A larger copy: every font, margin, shift and marker grows by the factor. Arrays are shared, never walked.
const SHIFTS = new Set(["xshift", "yshift", "ax", "ay", "standoff", "pad"]);
const enlarged = (value, factor, key = "") => {
    if (typeof value === "number") return SHIFTS.has(key) ? value * factor : value;
    if (value === null || typeof value !== "object" || ArrayBuffer.isView(value)) return value;
    if (Array.isArray(value)) {
        return typeof value[0] === "object" && !ArrayBuffer.isView(value[0]) ? value.map((v) => enlarged(v, factor)) : value;
    }
    const copy = {};
    for (const name in value) copy[name] = enlarged(value[name], factor, name);
    const grows = key.endsWith("font") || key === "marker" ? ["size"] : key === "line" ? ["width"] : key === "margin" ? Object.keys(copy) : [];
    for (const name of grows) if (typeof copy[name] === "number") copy[name] = copy[name] * factor;
    return copy;
};

// A trace that draws nothing and names nothing in the legend costs plotly as much as any other; the page leaves it out.
const draws = ({ showlegend, x }) => showlegend !== false || x === undefined || x.length > 0;

const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// plotly's code comes once per page, from whichever bench asks first; should its kernel die meanwhile, another one asks.
const plotly = async (model) => {
    const shared = (window.labkitPlotly ??= (() => {
        let resolve;
        return { asked: 0, arrived: new Promise((r) => { resolve = r; }), resolve: (lib) => resolve(lib) };
    })());
    while (!shared.lib) {
        if (Date.now() - shared.asked > 8000) {
            shared.asked = Date.now();
            model.send({ want: "plotly" });
        }
        await Promise.race([shared.arrived, sleep(8100)]);
    }
    return shared.lib;
};

const load = async (buffer) => {
    const shared = window.labkitPlotly;
    if (shared.lib || shared.loading) return;
    shared.loading = true;
    const packed = new Blob([buffer]).stream().pipeThrough(new DecompressionStream("gzip"));
    const address = URL.createObjectURL(await new Response(packed).blob());
    const script = Object.assign(document.createElement("script"), { src: address });
    const define = window.define;
    window.define = undefined;  // a module loader on the page would take plotly for itself
    script.onload = () => {
        window.define = define;
        URL.revokeObjectURL(address);
        shared.lib = window.Plotly;
        shared.resolve(shared.lib);
    };
    document.head.append(script);
};

const make = (tag, className, parent, properties = {}) => {
    const made = Object.assign(document.createElement(tag), { className, ...properties });
    parent.append(made);
    return made;
};
const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };

// Cards are made once; afterwards only what differs is written.
const drawCards = (strip, cards) => {
    while (strip.children.length > cards.length) strip.lastChild.remove();
    cards.forEach((card, i) => {
        const box = strip.children[i] ?? make("div", "lab-metric", strip, { innerHTML: "<b></b><span></span>" });
        box.className = `lab-metric${card.good === true ? " lab-good" : card.good === false ? " lab-bad" : ""}`;
        if (box.title !== card.note) box.title = card.note;
        put(box.children[0], card.text);
        put(box.children[1], [card.name, ...card.beside].join(" · "));
    });
};

// A plain key in a bench, such as an arrow on a slider, is not the notebook's; Ctrl+S still is. Jupyter reads this attribute.
window.labkitKeys ??= window.addEventListener("keydown", ({ target, ctrlKey, metaKey, altKey }) => {
    target.closest?.(".lab-bench")?.toggleAttribute("data-lm-suppress-shortcuts", !(ctrlKey || metaKey || altKey));
}, true) ?? true;

const render = ({ model, el }) => {
    el.classList.add("lab-plot");
    make("div", "lab-gone", el, { role: "status", textContent: "The kernel of this bench is gone. Run its cell again to get the bench back." });
    const alert = make("div", "lab-error-slot", el);
    const bar = make("div", "lab-bar", el);
    const cards = make("div", "lab-metrics", bar);
    const progress = make("progress", "lab-progress", bar, { max: 1, value: 0, hidden: true });
    const reset = make("button", "lab-button lab-reset", bar,
        { type: "button", textContent: "Reset", title: "all parameters back to where this bench started" });
    const lecture = make("button", "lab-button lab-lecture-switch", bar,
        { type: "button", textContent: "Lecture mode", title: "everything larger, for the last row" });
    const picture = make("div", "lab-picture", el);
    const code = make("code", "lab-code", el, { title: "copy this line to make the same bench again" });

    let shown = null, kept = [], large = false, width = 0, drawing = false, waiting = false, gone = false, asked = false;

    const draw = async () => {
        if (drawing) { waiting = true; return; }
        drawing = true;
        try {
            const lib = await plotly(model);
            do {
                waiting = false;
                if (gone || !shown || !width) return;
                const line = code.textContent;
                kept = [...shown.data.keys()].filter((i) => draws(shown.data[i]));
                let data = kept.map((i) => shown.data[i]), { layout } = shown;
                layout = { ...layout, font: { ...layout.font, size: layout.font?.size ?? FONT }, height: layout.height ?? 460 };
                if (large) {
                    data = enlarged(data, LECTURE);
                    layout = { ...enlarged(layout, LECTURE), height: Math.round(layout.height * 1.2) };
                }
                const first = !picture.classList.contains("js-plotly-plot");
                await lib.react(picture, data, { ...layout, width }, { displaylogo: false, responsive: false });
                picture.dataset.drawn = line;  // whose picture this is
                if (first) listen();
            } while (waiting);
        } finally { drawing = false; }
    };
    const listen = () => {
        picture.on("plotly_click", ({ points: [point] }) => {
            if (point?.data.meta?.set) model.send({ click: [kept[point.curveNumber], point.pointNumber] });
        });
        picture.on("plotly_relayout", (change) => {
            if (!shown?.layout.meta?.range || asked) return;
            const range = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
            if (change["xaxis.autorange"]) model.send({ range: null });
            else if (range[0] !== undefined) model.send({ range });
            else return;
            asked = true;  // until the answer is there
        });
    };
    const tell = ({ error, where, progress: done }) => {
        progress.hidden = done === null;
        if (done !== null) progress.value = done;
        el.classList.toggle("lab-stale", done !== null || error !== "");
        alert.replaceChildren();
        if (!error) return;
        const box = make("div", "lab-error", alert, { role: "alert", textContent: error });
        if (where) {
            const more = make("details", "", box);
            make("summary", "", more, { textContent: "where" });
            make("pre", "", more, { textContent: where });
        }
    };

    const take = (message, buffers) => {
        if (message.kind === "plotly") return void load(buffers[0]);
        tell(message.status);
        if (message.kind !== "show") return;
        asked = false;
        shown = unpack(message.figure, buffers);
        drawCards(cards, message.cards);
        put(code, message.code);
        draw();
    };
    model.on("msg:custom", take);
    reset.onclick = () => model.send({ reset: true });
    lecture.onclick = () => {
        large = !large;
        lecture.ariaPressed = String(large);
        el.closest(".lab-bench")?.classList.toggle("lab-lecture", large);
        draw();
    };
    const observer = new ResizeObserver(([box]) => {
        const now = Math.floor(box.contentRect.width);
        if (!now || now === width) return;
        width = now;
        draw();
    });
    observer.observe(picture);
    model.send({ want: "state" });
    return () => {
        gone = true;
        model.off("msg:custom", take);
        observer.disconnect();
        window.labkitPlotly?.lib?.purge(picture);
    };
};

export default { render };

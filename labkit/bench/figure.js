// A figure dict as plotly draws it, and plotly's code, once per page.

const ARRAYS = {
    float64: Float64Array, float32: Float32Array, int32: Int32Array, uint32: Uint32Array,
    int16: Int16Array, uint16: Uint16Array, int8: Int8Array, uint8: Uint8Array,
};

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

// A trace that draws nothing and names nothing in the legend costs plotly as much as any other; the page leaves it out.
const draws = ({ showlegend, x }) => showlegend !== false || x === undefined || x.length > 0;

// What is left of a pinned figure behind the live one: bars and curves, pale, mute, on axes that are still there.
const ghosts = (data, layout) => data
    .filter((trace) => ["bar", "scatter"].includes(trace.type ?? "scatter") && trace.x?.length && trace.x[0] !== null
        && (!trace.yaxis || trace.yaxis.replace("y", "yaxis") in layout))
    .map(({ text, meta, ...trace }) => ({
        ...trace, opacity: 0.3, showlegend: false, hoverinfo: "skip", hovertemplate: undefined, mode: trace.mode?.replace("+text", ""),
    }));

// Axes whose range is another one than before, in words; those that the reader zooms do not count.
const moved = (before, after) => (after.meta?.range ? [] : Object.keys(after))
    .filter((name) => /^[xy]axis/.test(name) && after[name].range && before[name]?.range && !after[name].ticktext
        && before[name].title?.text === after[name].title?.text && String(before[name].range) !== String(after[name].range))
    .map((name) => `${after[name].title?.text || "axis"} now from ${after[name].range.map((end) => +end.toPrecision(4)).join(" to ")}`);

const isArray = (value) => Array.isArray(value) || ArrayBuffer.isView(value);

// Names of the attributes that are arrays, such as "marker.color".
const arraysOf = (given, path = "") => Object.entries(given).flatMap(([name, value]) => {
    if (isArray(value)) return [path + name];
    return value && typeof value === "object" ? arraysOf(value, `${path}${name}.`) : [];
});

// To tell a reader about a point, plotly wants to know which attributes of a trace are arrays, and at every drawing looks for them
// through all that there are, a tenth of its time. They are among those that came as arrays; what is inside `meta` is not plotly's.
const findArrays = ({ PlotSchema }) => {
    const known = {};
    PlotSchema.findArrayAttributes = (trace) => arraysOf({ ...trace._input, meta: null }).filter((name) => {
        const path = name.split("."), what = (known[`${trace.type} ${name}`] ??= PlotSchema.getTraceValObject(trace, path));
        return what && (what.valType === "data_array" || what.arrayOk) && isArray(path.reduce((inside, key) => inside?.[key], trace));
    });
};

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
        answerable(shared.lib);
        findArrays(shared.lib);
        shared.resolve(shared.lib);
    };
    document.head.append(script);
};

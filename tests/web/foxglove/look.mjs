// Looks at a vehicle with the public client, tries to change it, and prints what came as one line of JSON.
import protocol from "@foxglove/ws-protocol";
import WebSocket from "ws";

const { FoxgloveClient } = protocol;
const [url, seconds, name = FoxgloveClient.SUPPORTED_SUBPROTOCOL] = process.argv.slice(2);
const seen = { name: null, info: null, channels: [], messages: {}, parameters: {}, statuses: [], graph: null, closed: null };
const line = new WebSocket(url, [name]);
const client = new FoxgloveClient({ ws: line });
const topics = new Map();
client.on("serverInfo", (info) => { seen.info = info; seen.name = line.protocol; });
client.on("status", (status) => seen.statuses.push(status.message));
client.on("advertise", (channels) => {
  for (const channel of channels) {
    seen.channels.push({ topic: channel.topic, encoding: channel.encoding, schemaName: channel.schemaName });
    topics.set(client.subscribe(channel.id), channel.topic);
  }
  client.getParameters([], "all");
  client.subscribeConnectionGraph();
  client.setParameters([{ name: "controller.k_x", value: 1e9 }], "mine");
  client.advertise({ topic: "/cmd", encoding: "json", schemaName: "Twist" });
  client.subscribeParameterUpdates(["controller.k_x"]);
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const topic = topics.get(subscriptionId);
  (seen.messages[topic] ??= []).push({ t: Number(timestamp) / 1e9, value: JSON.parse(new TextDecoder().decode(data)) });
});
client.on("parameterValues", ({ parameters, id }) => { seen.parameters[id ?? ""] = parameters; });
client.on("connectionGraphUpdate", (graph) => { seen.graph = graph; });
client.on("error", (error) => seen.statuses.push(`error: ${error.message}`));
client.on("close", ({ code }) => { seen.closed = code; });
setTimeout(() => client.sendMessage(1, new Uint8Array([123, 125])), 1000 * (seconds - 1)); // publishes: it is let go
setTimeout(() => { console.log(JSON.stringify(seen)); process.exit(0); }, 1000 * seconds);

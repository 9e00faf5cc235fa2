"""English sentences that complete other messages: unknown names, and several messages of the same kind."""

TEMPLATES: dict[str, str] = {
    "name.near": "Did you mean {match}? The valid names are {valid}",
    "name.near-only": "Did you mean {match}? The only valid name is {valid}",
    "name.none": "The list of valid names is empty",
    "name.unknown": "The valid names are {valid}",
    "name.unknown-only": "The only valid name is {valid}",
    "messages.list": "{first}, {second}",
    "messages.number": "{value:.4g}",
    "messages.others": "{first} (also {others})",
    "messages.then": "{first}. {second}.",
    "messages.times": "{first} ({count} times)",
}

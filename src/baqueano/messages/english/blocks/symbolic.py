"""English sentences of the engine: code that cannot be traced or compiled, and shapes that do not fit."""

TEMPLATES: dict[str, str] = {
    "trace.not-convertible": "{place}\n    values known only at run time cannot become {dtype}",
    "trace.unknown-ufunc": "{place}\n    the tracer does not support np.{function}; it supports {valid}",
    "trace.unsupported": (
        "{place}\n    np.{function} does not work on values known only at run time ({error}): write it with "
        "operators, np.where and sums"
    ),
    "trace.where-arms": "{place}\n    np.where needs three arguments: np.where(condition, a, b)",
    "trace.interp-period": (
        "{place}\n    np.interp does not accept a period here: first bring x into one period, x % period"
    ),
    "trace.interp-points": (
        "{place}\n    np.interp has {points} points that are known only at run time: expected at most 100"
    ),
    "trace.product-shapes": "{place}\n    shapes {left} and {right} do not fit in a product",
    "trace.solve-shapes": "{place}\n    np.linalg.solve does not accept the shapes {left} and {right}",
    "trace.norm": "{place}\n    np.linalg.norm supports only the Euclidean norm here",
    "trace.singular": "{place}\n    this is a singular matrix: column {column} does not have a pivot",
    "trace.decides": (
        "{place}\n"
        "    `if`, `and`, `or`, `not`, `while`, min(), max() and a < x < b need a value that is known only "
        "at run time. Write np.where(condition, a, b), np.clip, np.maximum or np.abs. Join conditions with "
        "&, | and ~. Functions of NumPy need an array instead of a list: np.clip(np.array([x, y]), -1, 1)"
    ),
    "trace.needs-float": (
        "{place}\n"
        "    a float is needed here, but the value is known only at run time. Write np.sin, np.sqrt, … "
        "instead of math.sin, math.sqrt, …. Inside the function, make arrays that are filled later with "
        "np.zeros or np.array. For a choice, write np.where(condition, a, b), np.clip, np.maximum or np.abs"
    ),
    "trace.prints": "{place}\n    compiled code cannot print: remove this line for full speed",
    "trace.needs-index": (
        "{place}\n    an index or a length must be known before run time: read tables with np.interp(x, xp, fp), "
        "choose between values with np.where"
    ),
    "trace.needs-int": (
        "{place}\n    a whole number is needed, but the value is known only at run time: write np.floor"
    ),
    "trace.bits": (
        "{place}\n    &, |, ^ and ~ need truth values here, such as x > 0, and this is a number: write n % 2 for its "
        "last bit, x > 0 for a condition"
    ),
    "engine.backend": 'backend = "{value}": expected one of {valid}',
    "compiler.no-library": "The library that {command} compiled cannot be stored or loaded: {error}",
    "compiler.refuses": "{command} cannot compile the code: {error}",
    "engine.arguments": "{value} arguments, expected {expected}: {names}",
    "engine.not-compiled": "Nothing is compiled yet",
    "trace.another-trace": (
        "{place}\n    this value belongs to another trace: the function stored it in a cache, a global "
        "or a field. A step must depend only on its arguments"
    ),
    "trace.not-pure": (
        "{function} gives another result at a second call with the same arguments. Keep memory in the state, not in "
        "the block. Time and noise must be inputs"
    ),
    "trace.pair": "{function} must return (carry, output); it returned {kind}",
    "trace.value": "{function} returned {value} for {path}, expected shape {shape}",
    "trace.leaf-shape": "{function} returned {path} with shape {value}, expected {expected}",
    "tree.value": "{path} is {value}, expected {expected} as in the example",
    "tree.branch": "{path} is {value}, expected {expected} as in the example",
    "tree.numbers": "{path} has shape {value} of {dtype}, expected numbers, {expected}",
    "engine.batch-sizes": (
        "The batch sizes of theta, carry and inputs are {sizes}, and inputs have {ticks} ticks. Expected "
        "one batch size and one number of ticks"
    ),
    "tree.another": "the structure at {path} differs from the example",
    "path.not-a-path": '"{path}" is not a path: write names with dots and indices in brackets, "a.b[0,2]"',
    "path.index": '"{path}": an index is one or more whole numbers, not [{value}]',
    "path.shape": '"{path}" has shape {expected}, not {value}',
    "engine.no-ticks": "The inputs have 0 ticks: the back end numpy needs at least one",
    "engine.cost": "A cost is one number per tick; this step returns {numbers}",
    "engine.theta-vector": "theta has shape {value}, expected (p,)",
    "engine.no-theta": "This scan was made without theta: pass an example as scan(..., theta=…).",
    "engine.theta-missing": "theta is missing: expected {parameters} parameters, {expected}",
    "engine.theta-shape": "theta has shape {value}, expected {expected} with p = {parameters}",
    "engine.no-parameters": "Derivatives need parameters: pass an example as scan(..., theta=…).",
    "engine.ticks": "{path} has shape {value}, expected (N, …) with {expected} after N",
    "engine.no-number": "The inputs do not contain a number, so the number of ticks is unknown: add one, such as t_ns",
    "trace.argument-changed": (
        "{place}\n    the function changes an argument in place. Make a new array, x = x + …, or "
        "work on a copy, np.array(x)"
    ),
    "trace.index": (
        "{place}\n"
        "    {kind}: {error}: an index must be known before run time. Write np.where(condition, a, b) to "
        "choose, np.interp(x, xp, fp) to read a table"
    ),
    "trace.numpy": "{place}\n    {kind}: {error}",
    "trace.another-carry": "{function} returned a carry that differs from its input: {cause}",
    "tree.dtype": "{path} is an array of {dtype}: expected numbers",
    "path.no-such-name": '"{path}": {kind} does not have {value}. {suggestion}',
    "compiler.absent": "a C compiler was not found: install gcc or clang, or type: {fix}",
    "compiler.no-command": "BAQUEANO_CC = '{value}': this command does not exist",
    "compiler.python-used": "Python is used instead of C, and this is slower: {cause}",
}

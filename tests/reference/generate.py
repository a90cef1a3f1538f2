"""Writes layers.txt: values and gradients of PyTorch layers, against which tests/pytorch_reference.rs checks ours.

Made with PyTorch 2.15.0 on the CPU, in f64 and rounded to f32 on writing. Run it in this directory:

    python3 generate.py > layers.txt

A line is `case kind name rows cols : values`, row-major, with the kinds x (input), gx (its gradient), p (parameter, by
our name and in our layout), gp (its gradient), y (output) and dy (the gradient that is pulled back). Inputs and
parameters are multiples of 1/1024, so that f32 and f64 hold the same numbers.
"""

import torch

torch.manual_seed(7)
torch.set_default_dtype(torch.float64)


def draw(*shape, scale=1.0):
    return (torch.randn(*shape) * scale * 1024).round() / 1024


def line(case, kind, name, tensor):
    t = tensor.detach().reshape(1, -1) if tensor.dim() < 2 else tensor.detach()
    print(f"{case} {kind} {name} {t.shape[0]} {t.shape[1]} :", *(f"{v:.8g}" for v in t.flatten().tolist()))


def linear(prefix, module):
    """Ours is c_in x c_out, PyTorch's c_out x c_in."""
    return [(f"{prefix}weight", lambda: module.weight, True), (f"{prefix}bias", lambda: module.bias, False)]


def norm(prefix, module):
    return [(f"{prefix}gain", lambda: module.weight, False), (f"{prefix}bias", lambda: module.bias, False)]


def perceptron(prefix, module):
    layers = [m for m in module if isinstance(m, torch.nn.Linear)]
    return [entry for i, m in enumerate(layers) for entry in linear(f"{prefix}layer{i}.", m)]


def attention(prefix, module, c):
    """PyTorch stacks the three projections, unless the memory has another width."""
    same = module.in_proj_weight is not None
    weights = {"query": "q_proj_weight", "key": "k_proj_weight", "value": "v_proj_weight"}
    entries = []
    for i, (name, separate) in enumerate(weights.items()):
        part = slice(i * c, (i + 1) * c)
        if same:
            entries.append((f"{prefix}{name}.weight", (module, "in_proj_weight", part), True))
        else:
            entries.append((f"{prefix}{name}.weight", (module, separate, slice(None)), True))
        entries.append((f"{prefix}{name}.bias", (module, "in_proj_bias", part), False))
    return entries + linear(f"{prefix}out.", module.out_proj)


def resolve(source):
    """The tensor and, after the backward pass, its gradient."""
    if isinstance(source, tuple):
        module, attribute, part = source
        whole = getattr(module, attribute)
        return whole[part], whole.grad[part] if whole.grad is not None else None
    whole = source()
    return whole, whole.grad


def case(name, modules, entries, inputs, forward):
    for module in modules:
        for p in module.parameters():
            with torch.no_grad():
                p.copy_(draw(*p.shape, scale=0.4))
    for i, x in enumerate(inputs):
        x.requires_grad_(True)
    y = forward(*inputs)
    dy = draw(*y.shape)
    y.backward(dy)
    for i, x in enumerate(inputs):
        line(name, "x", i, x)
        line(name, "gx", i, x.grad)
    for ours, source, transpose in entries:
        value, grad = resolve(source)
        line(name, "p", ours, value.T if transpose else value)
        line(name, "gp", ours, grad.T if transpose else grad)
    line(name, "y", "-", y)
    line(name, "dy", "-", dy)


nn = torch.nn

layer = nn.Linear(4, 3)
case("linear", [layer], linear("", layer), [draw(5, 4)], layer)

case("softmax", [], [], [draw(4, 7, scale=2.0)], lambda x: torch.softmax(x, dim=1))

layer = nn.LayerNorm(6)
case("norm", [layer], norm("", layer), [draw(5, 6)], layer)

for name, activation in [("relu", nn.ReLU()), ("softplus", nn.Softplus(beta=5.0)), ("tanh", nn.Tanh())]:
    layer = nn.Sequential(nn.Linear(3, 6), activation, nn.Linear(6, 5), activation, nn.Linear(5, 2))
    case(f"mlp_{name}", [layer], perceptron("", layer), [draw(5, 3)], layer)

layer = nn.MultiheadAttention(8, 2, kdim=5, vdim=5)
case("attention", [layer], attention("", layer, 8), [draw(4, 8), draw(6, 5)], lambda x, m: layer(x, m, m)[0])

# Two of five memory rows per query: the others masked out.
INDEX = [[0, 3], [2, 1], [4, 0], [3, 4]]
mask = torch.ones(4, 5, dtype=torch.bool)
for i, row in enumerate(INDEX):
    mask[i, row] = False
layer = nn.MultiheadAttention(6, 3)
case(
    "local",
    [layer],
    attention("", layer, 6),
    [draw(4, 6), draw(5, 6)],
    lambda x, m: layer(x, m, m, attn_mask=mask)[0],
)

layer = nn.TransformerDecoderLayer(8, 2, dim_feedforward=10, dropout=0.0, activation="relu", norm_first=True)
entries = (
    norm("norm_self.", layer.norm1)
    + attention("self.", layer.self_attn, 8)
    + norm("norm_cross.", layer.norm2)
    + attention("cross.", layer.multihead_attn, 8)
    + norm("norm_feed.", layer.norm3)
    + linear("feed.layer0.", layer.linear1)
    + linear("feed.layer1.", layer.linear2)
)
case("decoder", [layer], entries, [draw(5, 8), draw(4, 8)], layer)

# The point transformer layer has no counterpart in PyTorch; this is its formula in plain tensors.
NEIGHBOURS = torch.tensor([[0, 1, 2], [1, 0, 4], [2, 3, 1], [3, 2, 0], [4, 1, 3]])
alpha, beta, eta = nn.Linear(4, 6), nn.Linear(4, 6), nn.Linear(4, 6)
gamma = nn.Sequential(nn.Linear(6, 6), nn.ReLU(), nn.Linear(6, 6))
delta = nn.Sequential(nn.Linear(3, 6), nn.ReLU(), nn.Linear(6, 6))


def point_transformer(x, points):
    xi = delta(points[:, None, :] - points[NEIGHBOURS])
    weights = torch.softmax(gamma(beta(x)[:, None, :] - eta(x)[NEIGHBOURS] + xi), dim=1)
    return (weights * (alpha(x)[NEIGHBOURS] + xi)).sum(dim=1)


entries = (
    linear("alpha.", alpha)
    + linear("beta.", beta)
    + linear("eta.", eta)
    + perceptron("gamma.", gamma)
    + perceptron("delta.", delta)
)
case("points", [alpha, beta, eta, gamma, delta], entries, [draw(5, 4), draw(5, 3)], point_transformer)

# Five steps each: x is the start, g0 to g4 the gradients, y where it ends.
for name, optimiser in [
    ("adam", lambda p: torch.optim.Adam(p, lr=0.05)),
    ("adamw", lambda p: torch.optim.AdamW(p, lr=0.05, betas=(0.8, 0.95), eps=1e-6, weight_decay=0.3)),
]:
    p = draw(3, 4).requires_grad_(True)
    line(name, "x", 0, p)
    o = optimiser([p])
    for step in range(5):
        p.grad = draw(3, 4)
        line(name, "g", step, p.grad)
        o.step()
    line(name, "y", "-", p)

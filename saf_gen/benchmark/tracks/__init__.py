"""The evaluator's side: it runs methods on recordings or a running camera, and judges what they answer."""

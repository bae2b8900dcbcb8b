"""Samples of topics as structured NumPy arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Optional

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import pandas
    import polars
    import xarray

#: Values by the names of columns, all of one length.
Columns = dict[str, "npt.NDArray[Any]"]


class Samples(np.ndarray[Any, np.dtype[Any]]):
    """Samples of one topic: a structured NumPy array of shape (n,), one field for each of the message's.

    An array field, such as ``q_rad``, has shape (n, 8); its entries beyond the plant's joints are zero. ``t_s`` is the time of
    measurement since the start of the log. ``meanings`` has what each field means, units and frames.

    It looks at the bytes as they lay in the log: taking a field copies nothing.
    """

    topic: str
    start_ns: int
    meanings: dict[str, str]

    def __array_finalize__(self, source: Any) -> None:
        self.topic = getattr(source, "topic", "")
        self.start_ns = getattr(source, "start_ns", 0)
        self.meanings = getattr(source, "meanings", {})

    def __reduce__(self) -> Any:
        rebuild, arguments, state = tuple(super().__reduce__())
        return rebuild, arguments, (state, self.topic, self.start_ns, self.meanings)

    def __setstate__(self, state: Any) -> None:
        array, self.topic, self.start_ns, self.meanings = state
        super().__setstate__(array)

    def __getitem__(self, key: Any) -> Any:
        found = super().__getitem__(key)
        # A field alone is a plain array.
        return found.view(np.ndarray) if isinstance(key, str) and isinstance(found, Samples) else found

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields."""
        return tuple(self.dtype.names or ())

    @property
    def t_s(self) -> npt.NDArray[np.float64]:
        """Times of measurement since the start of the log (s), shape (n,)."""
        if "stamp_ns" not in self.fields:
            return np.asarray(self["t_s"], dtype=np.float64)
        since_ns: npt.NDArray[np.int64] = self["stamp_ns"].astype(np.int64) - self.start_ns
        return since_ns.astype(np.float64) * 1e-9

    def columns(self) -> Columns:
        """Columns with the names that ``fss log export`` gives: an array field is ``q_rad.0``, ``q_rad.1`` and so on."""
        columns: Columns = {}
        for name in self.fields:
            values = self[name]
            if values.ndim == 2:
                columns.update({f"{name}.{i}": values[:, i] for i in range(values.shape[1])})
            elif values.dtype.kind == "S":
                columns[name] = np.array([text.decode("utf-8", "replace") for text in values], dtype=object)
            else:
                columns[name] = values
        return columns

    def to_pandas(self) -> pandas.DataFrame:
        """A DataFrame of :meth:`columns`, its index ``t_s``. Needs pandas."""
        import pandas as pd

        return pd.DataFrame(self.columns(), index=pd.Index(self.t_s, name="t_s"))

    def to_polars(self) -> polars.DataFrame:
        """A DataFrame of ``t_s`` and :meth:`columns`. Needs polars."""
        import polars as pl

        columns = {name: list(v) if v.dtype == object else np.ascontiguousarray(v) for name, v in self.columns().items()}
        return pl.DataFrame({"t_s": self.t_s, **columns})

    def to_xarray(self) -> xarray.Dataset:
        """A Dataset over ``t_s``; an array field has a dimension of its own, meanings are attributes. Needs xarray."""
        import xarray as xr

        variables = {}
        for name in self.fields:
            values = self[name]
            dimensions = ("t_s", f"{name}_index") if values.ndim == 2 else ("t_s",)
            variables[name] = (dimensions, values, {"meaning": self.meanings.get(name, "")})
        return xr.Dataset(variables, coords={"t_s": self.t_s}, attrs={"topic": self.topic})

    def resample(self, t_s: npt.ArrayLike) -> Samples:
        """The samples at other times (s, since the start of the log): numbers with a fraction are interpolated between the
        samples beside them, all others hold until the next. Before the first and after the last sample they stay.

        Raises ValueError where there is no sample.
        """
        at = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
        if len(self) == 0:
            raise ValueError(f"{self.topic or 'this topic'} has no sample to resample")
        own = self.t_s
        order = np.argsort(own, kind="stable")
        own, source = own[order], self[order]
        before = np.clip(np.searchsorted(own, at, side="right") - 1, 0, len(own) - 1)
        resampled: Samples = source[before].copy()
        for name in self.fields:
            values = source[name]
            if values.dtype.kind != "f":
                continue
            flat = values.reshape(len(values), -1)
            columns = [np.interp(at, own, flat[:, i]) for i in range(flat.shape[1])]
            resampled[name] = np.stack(columns, axis=1).reshape(len(at), *values.shape[1:])
        if "stamp_ns" in self.fields:
            resampled["stamp_ns"] = np.round(at * 1e9).astype(np.int64) + self.start_ns
        return resampled


def samples_of(
    fields: list[tuple[str, str, int, str]], size: Optional[int], data: npt.NDArray[np.uint8], topic: str, start_ns: int
) -> Samples:
    """Looks at bytes of samples as an array."""
    dtype = dtype_of(fields, size)
    samples = data.view(dtype).view(Samples)
    samples.topic, samples.start_ns = topic, start_ns
    samples.meanings = {name: meaning for name, _, _, meaning in fields}
    return samples


def dtype_of(fields: list[tuple[str, str, int, str]], size: Optional[int] = None) -> np.dtype[Any]:
    """The type of a sample with these fields (name, NumPy type, offset, meaning)."""
    described: dict[str, Any] = {
        "names": [name for name, _, _, _ in fields],
        "formats": [kind for _, kind, _, _ in fields],
        "offsets": [offset for _, _, offset, _ in fields],
    }
    if size is not None:
        described["itemsize"] = size
    return np.dtype(described)  # type: ignore[call-overload, no-any-return]

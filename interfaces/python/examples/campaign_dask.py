"""A campaign on two local workers of Dask; its rows as one Parquet table, as `fss campaign` writes it."""

import sys
from typing import Any

import fss


def main(folder: str) -> None:
    from dask.distributed import Client, LocalCluster

    campaign = fss.campaign("slew", out=folder, seeds=range(1, 5), sweep={"laboratory.base.mass_kg": [9.5, 10.5]})
    # Dask has no types of its own.
    cluster: Any = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)  # type: ignore[no-untyped-call]
    with cluster, Client(cluster) as client:  # type: ignore[no-untyped-call]
        rows = client.gather(client.map(lambda task: task(), list(campaign), pure=False))
    table = campaign.write(rows)
    print(f"{sum(row['success'] for row in rows)} of {len(rows)} succeeded; {table}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "out/python/campaign")

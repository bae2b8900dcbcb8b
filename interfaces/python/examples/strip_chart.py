"""A strip chart of the base's heading while a stack flies: `fss run hold` in another terminal, then this."""

import matplotlib.pyplot as plt
import numpy as np

import fss

t_s, theta_rad = np.empty(0), np.empty(0)
line = plt.gca().plot([], [])[0]
with fss.live("/nav/state") as nav:
    for samples in nav.stream(period_s=0.05):
        t_s = np.append(t_s, samples.t_s)[-2000:]
        theta_rad = np.append(theta_rad, samples["theta_rad"])[-2000:]
        line.set_data(t_s, np.degrees(theta_rad))
        plt.gca().relim()
        plt.gca().autoscale_view()
        plt.pause(0.01)

"""The result for people and programs: registration.json, poses.csv, report.html."""
